"""Plugins found by entry points, from packages made for each test."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from artemis.errors import PluginError
from artemis.plugins import registry
from artemis.plugins.followers.indiveri import IndiveriFollower
from artemis.plugins.inputs.scripted import ScriptedInput
from artemis.plugins.registry import FOLLOWERS, INPUTS, listing, load
from artemis.plugins.stated import follower_speed, input_speed, is_live, is_pure

GOOD = """
from artemis.config import Config

class Stick:
    Config = Config
    def __init__(self, config, setup): ...
    def read(self, now): ...
    def close(self): ...
"""


class Site:
    """A folder of installed packages."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def install(self, package: str, source: str, name: str = "pad", group: str = INPUTS, version: str = "1.2") -> None:
        module = package.replace("-", "_")
        (self.folder / f"{module}.py").write_text(source, encoding="utf-8")
        info = self.folder / f"{module}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n", encoding="utf-8"
        )
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {module}:Stick\n", encoding="utf-8")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield Site(tmp_path)
    for name in set(sys.modules) - before:
        if name.startswith("plugin_"):
            del sys.modules[name]


def reason(name: str, group: str = INPUTS) -> str:
    with pytest.raises(PluginError) as caught:
        load(group, name)
    return str(caught.value)


def test_built_in_plugins_come_by_the_same_door() -> None:
    assert load(INPUTS, "scripted") is ScriptedInput
    assert load(FOLLOWERS, "indiveri") is IndiveriFollower


def test_strangers_plugin_is_loaded_and_listed(site: Site) -> None:
    site.install("plugin-pad", GOOD)
    assert load(INPUTS, "pad").__name__ == "Stick"
    listed = {entry.name: entry for entry in listing(INPUTS)}
    assert listed["pad"].distribution == "plugin-pad"
    assert listed["pad"].version == "1.2"
    assert listed["pad"].target == "plugin_pad:Stick"
    assert listed["pad"].error is None
    assert listed["scripted"].distribution == "artemis-robot"


def test_listing_imports_nothing(site: Site) -> None:
    site.install("plugin-pad", GOOD)
    listing(INPUTS)
    assert "plugin_pad" not in sys.modules


def test_broken_plugin_tells_its_reason_and_harms_nobody(site: Site) -> None:
    site.install("plugin-bad", "import nothing_of_the_kind\n", name="bad")
    site.install("plugin-pad", GOOD)
    with pytest.raises(PluginError, match=r"'bad' of plugin-bad .* ModuleNotFoundError: No module named") as caught:
        load(INPUTS, "bad")
    assert isinstance(caught.value.__cause__, ModuleNotFoundError)
    assert load(INPUTS, "pad")
    errors = {entry.name: entry.error for entry in listing(INPUTS, check=True)}
    assert errors["pad"] is None
    assert errors["scripted"] is None
    assert "nothing_of_the_kind" in str(errors["bad"])
    assert {entry.error for entry in listing(INPUTS)} == {None}


@pytest.mark.parametrize("source", ["raise SystemExit(3)", "1/0", "Stick ="])
def test_whatever_an_import_raises_is_a_plugin_error(site: Site, source: str) -> None:
    site.install("plugin-bad", source, name="bad")
    assert "cannot be imported" in reason("bad")


def test_missing_class_is_named(site: Site) -> None:
    site.install("plugin-bad", "Pad = 1", name="bad")
    assert "plugin_bad" in reason("bad")
    assert "Stick" in reason("bad")


def test_two_owners_of_a_name_are_both_named(site: Site) -> None:
    site.install("plugin-pad", GOOD)
    site.install("plugin-other", GOOD)
    assert "'pad' is claimed by plugin-other (plugin_other:Stick) and plugin-pad (plugin_pad:Stick)" in reason("pad")
    assert [entry.error is None for entry in listing(INPUTS) if entry.name == "pad"] == [False, False]
    assert load(INPUTS, "scripted")


def test_unknown_name_gives_the_nearest() -> None:
    assert "no plugin 'scriptet'; nearest is 'scripted'" in reason("scriptet")
    assert "nearest is 'indiveri'" in reason("indivery", FOLLOWERS)


def test_empty_group_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "entry_points", lambda group: ())
    assert "none is installed" in reason("pad")


def test_other_contract_version_is_refused(site: Site) -> None:
    site.install("plugin-pad", GOOD + "    contract = 7\n")
    assert "was written for contract 7; this artemis has contract 1" in reason("pad")


def test_stated_contract_version_is_accepted(site: Site) -> None:
    site.install("plugin-pad", GOOD + "    contract = 1\n")
    assert load(INPUTS, "pad")


def test_every_missing_member_is_named(site: Site) -> None:
    site.install("plugin-pad", "class Stick:\n    Config = dict\n    read = 3\n")
    with pytest.raises(PluginError) as caught:
        load(INPUTS, "pad")
    text = "\n".join(caught.value.problems)
    assert len(caught.value.problems) == 3
    assert "has no method read()" in text
    assert "has no method close()" in text
    assert "has no Config that is a subclass of artemis.config.Config" in text


def test_input_is_no_follower(site: Site) -> None:
    site.install("plugin-pad", GOOD, group=FOLLOWERS)
    assert "has no method start()" in reason("pad", FOLLOWERS)


def test_what_is_no_class_is_refused(site: Site) -> None:
    site.install("plugin-pad", "Stick = 12\n")
    assert "is not a class but 12" in reason("pad")


@pytest.mark.parametrize("name", ["live", "pure"])
def test_what_a_plugin_states_is_true_or_false(site: Site, name: str) -> None:
    site.install("plugin-pad", GOOD + f"    {name} = 'yes'\n")
    assert f"states {name} = 'yes': True or False is meant" in reason("pad")


class Silent:
    pass


class Stating:
    live = pure = True
    speed_m_s: object = 0.3
    max_speed_m_s: object = None


def test_what_a_plugin_does_not_state_is_none_of_it() -> None:
    assert (is_live(Silent), is_pure(Silent), input_speed(Silent()), follower_speed(Silent())) == (
        False,
        False,
        None,
        None,
    )
    assert (is_live(Stating), is_pure(Stating()), input_speed(Stating()), follower_speed(Stating())) == (
        True, True, None, 0.3,
    )  # fmt: skip


@pytest.mark.parametrize("speed", ["fast", True, [1.0]])
def test_speed_that_is_no_number_is_an_error_of_the_plugin(speed: object) -> None:
    stating = Stating()
    stating.speed_m_s = stating.max_speed_m_s = speed
    for read in (input_speed, follower_speed):
        with pytest.raises(PluginError, match=r"Stating states the speed .*: artemis needs a number \[m/s\], or None"):
            read(stating)
