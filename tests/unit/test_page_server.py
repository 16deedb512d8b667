"""The page's server over real connections: who is answered, what is told, what a slow or hostile client costs."""

from __future__ import annotations

import json
import re
import shutil
import socket
import ssl
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import pytest
from page_rig import PATIENCE, PageRig, page_rig, recorded
from pydantic import ValidationError
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from artemis.bridges.operator.server import TlsFiles
from artemis.page import paired as paired_server
from artemis.page.access import key_place
from artemis.page.certificates import kept, make
from artemis.page.observer import PageObserverConfig
from artemis.page.paired import SHARED, STATIC
from artemis.values import Mode, Request

MOST_BYTES = 300_000


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageRig]:
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder))
        run = recorded("figure_eight.yaml", 9.0, folder)
        with page_rig(run, folder) as made:
            made.show(run.at(lambda tick: tick.mode is Mode.FOLLOW) + 60)
            made.wait(lambda sample: True)
            yield made


@pytest.fixture(scope="module")
def paired(rig: PageRig) -> Iterator[httpx.Client]:
    with rig.client() as client:
        code = rig.pairing().split("#")[1]
        assert client.post("/pair", json={"code": code}).status_code == 200
        assert client.post("/pair", json={"code": code}).status_code == 403
        yield client


def told(connection: ClientConnection, wanted: str) -> dict[str, Any]:
    """The next message of a kind, or with such a part."""
    while True:
        message: dict[str, Any] = json.loads(connection.recv(PATIENCE))
        if message.get("t") == wanted or wanted in message:
            return message


def test_a_connection_that_says_nothing_leaves_room_for_others(
    rig: PageRig, paired: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    with rig.link(paired, "/telemetry") as watching:
        assert told(watching, "state")
        monkeypatch.setattr(paired_server, "FIRST_REQUEST", 0.05)  # only now: a busy machine may greet as slowly
        with socket.create_connection(("127.0.0.1", rig.port)) as silent:
            silent.settimeout(20.0)
            assert silent.recv(1) == b""
        assert told(watching, "state")


def test_who_has_not_paired_sees_nothing(rig: PageRig) -> None:
    with rig.client() as stranger:
        assert stranger.get("/").headers["location"] == "/pair"
        assert stranger.get("/pair").status_code == 200
        for answer in (
            stranger.get("/history"),
            stranger.post("/stop", json={"t": "stop", "id": "x"}),
            stranger.post("/invite"),
            stranger.post("/pair", json={"code": "x"}),
            stranger.post("/pair", content=b"["),
        ):
            assert answer.status_code == 403
        for path in ("/telemetry", "/control"):
            with pytest.raises(InvalidStatus):
                rig.link(stranger, path)


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"host": "evil.example"}, {"origin": ""}])
def test_pages_of_others_cannot_ask(rig: PageRig, paired: httpx.Client, headers: dict[str, str]) -> None:
    answer = paired.post("/stop", json={"t": "stop", "id": "cross"}, headers=headers)
    assert answer.status_code == 403
    with pytest.raises(InvalidStatus):
        rig.link(paired, "/control", origin=headers.get("origin") or "http://evil.example")


def test_every_answer_has_the_content_policy(paired: httpx.Client) -> None:
    for path in ("/", "/pair", "/static/main.js", "/static/nothing.js", "/history"):
        assert "default-src 'self'" in paired.get(path).headers["content-security-policy"]


@pytest.mark.parametrize("page", ["index", "runs_replay", "runs", "waiting", "pair"])
def test_pages_are_put_together_of_their_parts(paired: httpx.Client, page: str) -> None:
    text = paired.get(f"/static/{page}.html").text
    assert (text.count("<!doctype html>"), text.count("</head>"), text.count("<!--")) == (1, 1, 0)
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(ids) == len(set(ids))


@pytest.mark.parametrize(
    "path", ["../server.py", "..%2fserver.py", "uplot/LICENSE", "%2e%2e/access.py", "", "x" * 300 + ".js", "%00.js"]
)
def test_only_the_page_s_files_are_given(paired: httpx.Client, path: str) -> None:
    assert paired.get(f"/static/{path}").status_code == 404


def test_a_file_that_the_browser_has_is_not_sent_again(paired: httpx.Client) -> None:
    tag = paired.get("/static/main.js").headers["etag"]
    assert paired.get("/static/main.js", headers={"if-none-match": tag}).status_code == 304


def test_what_is_told_first_and_then(rig: PageRig, paired: httpx.Client) -> None:
    with rig.link(paired, "/telemetry") as connection:
        first = told(connection, "about")
        assert (first["about"]["robot"], first["about"]["mission"]) == ("ARTEMIS", "figure-eight")
        assert len(first["path"]["points"]) > 100
        assert any("follow" in line["text"] for line in first["log"])
        then = told(connection, "state")
        assert then["state"]["mode"] == "follow"
        assert "path" not in then, "once"
        assert "about" not in then
    rows = paired.get("/history").json()
    assert len(rows[0]) == len(first["about"]["series"])


def test_driving_and_stopping_over_the_link(rig: PageRig, paired: httpx.Client) -> None:
    with rig.link(paired, "/control") as connection:
        assert told(connection, "seat")["run"] is True
        connection.send(json.dumps({"t": "take", "who": "a test"}))
        assert told(connection, "seat")["mine"] is True
        sequence = 0

        def hold(**words: object) -> None:
            nonlocal sequence
            sequence += 1
            beat = told(connection, "beat")["n"]
            connection.send(json.dumps({"t": "hold", "seq": sequence, "beat": beat, **words}))

        while not (rig.samples[-1][1].neutral and rig.samples[-1][1].buttons == (False,)):
            hold()
        for turn in count():  # what comes too late has no effect, and then it has to be released once
            if rig.samples[-1][1].enabled and rig.samples[-1][1].speed > 0 > rig.samples[-1][1].steering:
                break
            hold(held=turn % 10 > 0, neutral=turn % 10 == 0, x=0.5, y=0.5)
        connection.send(json.dumps({"t": "stop", "id": "both ways"}))
        answer = paired.post("/stop", json={"t": "stop", "id": "both ways"})
        assert (answer.status_code, answer.json()) == (202, {"id": "both ways"})
        rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
        connection.send(json.dumps({"t": "release"}))
        rig.wait(lambda sample: not sample.enabled and sample.neutral)
    stops = [request for _, sample, _ in rig.samples for request in sample.requests]
    assert stops.count(Request.QUICKSTOP) == 1


@pytest.mark.parametrize("message", ["", "nonsense", b"\x00\x01", "x" * 4000])
def test_nonsense_closes_that_connection_alone(rig: PageRig, paired: httpx.Client, message: str | bytes) -> None:
    with rig.link(paired, "/control") as connection, rig.link(paired, "/control") as other:
        told(connection, "seat")
        connection.send(message)
        with pytest.raises(ConnectionClosed):
            told(connection, "nothing more")
        other.send(json.dumps({"t": "ping", "at": 1.0}))
        assert told(other, "pong")["at"] == 1.0


@pytest.mark.parametrize("body", [b"", b"{}", b'{"t":"take"}', b'{"t":"stop"}', b"x" * 5000])
def test_a_stop_that_cannot_be_read_is_refused(paired: httpx.Client, body: bytes) -> None:
    assert paired.post("/stop", content=body).status_code == 400


def test_an_invitation_pairs_another_browser(rig: PageRig, paired: httpx.Client) -> None:
    invitation = paired.post("/invite").json()
    assert invitation["url"].startswith(f"{rig.url}/pair#")
    assert {len(row) for row in invitation["rows"]} == {len(invitation["rows"])}
    with rig.client() as another:
        assert another.post("/pair", json={"code": invitation["code"]}).status_code == 200
        assert another.get("/history").status_code == 200


def test_a_browser_is_told_why_no_code_is_taken(rig: PageRig) -> None:
    used = key_place().with_name("page.used")
    content = used.read_bytes() if used.exists() else b""
    with rig.client() as stranger:
        used.write_bytes(b"nonsense")
        answer = stranger.post("/pair", json={"code": rig.pairing().split("#")[1]})
        used.write_bytes(content)
        assert (answer.status_code, answer.json()["paired"]) == (503, False)
        assert answer.json()["problem"].startswith("page.used is damaged")
        assert "set-cookie" not in answer.headers


@pytest.mark.realtime
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the program openssl")
def test_certificates_that_it_makes_encrypt_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    authority = make(["robot.lan"])
    assert kept() == (authority.with_name("robot.pem"), authority.with_name("robot.key"))
    robot = authority.with_name("robot.pem").read_bytes()
    make([])
    assert authority.with_name("robot.pem").read_bytes() != robot, "renewed, by the same authority"
    certificate, key = map(str, kept() or ())
    trusted = ssl.create_default_context(cafile=str(authority))
    run = recorded("figure_eight.yaml", 9.0, tmp_path)
    with page_rig(run, tmp_path, TlsFiles(certificate=certificate, key=key)) as rig:
        rig.show(50)
        with rig.client(trusted) as client:
            code = rig.pairing().split("#")[1]
            cookie = client.post("/pair", json={"code": code}).headers["set-cookie"]
            assert {"HttpOnly", "Secure", "SameSite=strict"} <= set(cookie.split("; "))
            with rig.link(client, "/telemetry", trusted=trusted) as connection:
                assert told(connection, "about")["about"]["robot"] == "ARTEMIS"


@pytest.mark.parametrize("address", ["0.0.0.0", "192.168.1.7", "::"])
def test_other_computers_need_tls(address: str) -> None:
    with pytest.raises(ValidationError, match="artemis page certificate"):
        PageObserverConfig(listen=address)
    PageObserverConfig(listen=address, tls=TlsFiles(certificate="a", key="b"))


# ---------------------------------------------------------------------------------------------------- its files


def test_the_whole_page_is_small_and_names_no_other_computer() -> None:
    files = [path for path in (*STATIC.iterdir(), *(SHARED / "uplot").iterdir()) if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= MOST_BYTES
    for path in files:
        if path.parent == STATIC:
            text = path.read_text().replace("http://www.w3.org/2000/svg", "")
            assert "http://" not in text
            assert "https://" not in text
            assert "innerHTML" not in text, "nothing that a robot or an operator says becomes markup"
