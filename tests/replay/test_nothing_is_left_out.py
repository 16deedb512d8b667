"""A replay notices a change of every field of a tick, down to the last number: none can be left out of the record."""

# ruff: noqa: ANN401  (types are walked as they are)

from __future__ import annotations

from base64 import b64decode
from collections.abc import Iterator
from enum import Enum
from math import inf, nan, nextafter
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints

import pytest
from msgspec import Struct
from msgspec.structs import replace
from rig import CALIBRATE, follow, run, write_mission

from artemis.mission.loading import load_mission
from artemis.planning import core_from
from artemis.recording.mcap_reader import Recording
from artemis.recording.replay import replay
from artemis.recording.schemas import tick_from_record, tick_record
from artemis.robot import Core
from artemis.scan import Scan
from artemis.states.follow import FollowMode
from artemis.values import Snapshot, Tick, Verdict, Wish

pytestmark = pytest.mark.short_alignment

NULLS = b64decode("null" * 2 + "nullAA==")
"""Bytes that look in JSON as if something were None."""
Place = tuple[str | int, ...]


def parts_of(kind: Any) -> tuple[Any, bool]:
    """A type without its None, and whether None is one of its values."""
    if get_origin(kind) is UnionType:
        return next(part for part in get_args(kind) if part is not NoneType), True
    return kind, False


def made(kind: Any) -> Any:
    """A value of a type in which everything is there: no None, nothing empty."""
    kind, _ = parts_of(kind)
    if get_origin(kind) is tuple:
        return tuple(made(part) for part in get_args(kind) if part is not Ellipsis)
    if issubclass(kind, Struct):
        return kind(**{name: made(hint) for name, hint in get_type_hints(kind).items()})
    if issubclass(kind, Enum):
        return next(iter(kind))
    return {bool: True, int: 3, float: 0.1, str: "word", bytes: b"\x00\x01\xff"}[kind]


def others(kind: Any, value: Any) -> list[Any]:
    """Values of a type that differ from `value` as little as they can, or in kind."""
    kind, optional = parts_of(kind)
    nothing = [None] if optional else []
    if get_origin(kind) is tuple:
        return [*nothing, (), (*value, value[-1])] if Ellipsis in get_args(kind) else nothing
    if issubclass(kind, Struct):
        return nothing
    if issubclass(kind, Enum):
        return [*nothing, next(other for other in kind if other is not value)]
    if kind is float:
        return [*nothing, nextafter(value, 1.0), nan, inf, -value]
    return [*nothing, {bool: False, int: 4, str: "word null", bytes: NULLS}[kind]]


def changes(kind: Any, value: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every value that differs from `value` in one place, and that place."""
    for other in others(kind, value):
        yield place, other
    kind, _ = parts_of(kind)
    if get_origin(kind) is tuple:
        hints = [part for part in get_args(kind) if part is not Ellipsis]
        for number, hint in enumerate(hints):
            for where, other in changes(hint, value[number], (*place, number)):
                yield where, (*value[:number], other, *value[number + 1 :])
    elif issubclass(kind, Struct):
        for name, hint in get_type_hints(kind).items():
            for where, other in changes(hint, getattr(value, name), (*place, name)):
                yield where, replace(value, **{name: other})


WHOLE: Tick = made(Tick)
CHANGES = list(changes(Tick, WHOLE))


def replayed(recorded: Tick, now: Tick) -> str | None:
    """What a replay says of a recording of one tick with a core that makes another of it."""
    ticks = [tick_from_record(tick_record(recorded))]
    recording = SimpleNamespace(ticks=lambda: iter(ticks), number_before_gap=None)
    core = SimpleNamespace(decide=lambda sensed: now)
    return replay(cast("Recording", recording), cast("Core", core)).difference


def test_every_field_of_the_values_of_a_tick_is_changed_here() -> None:
    places = {place for place, _ in CHANGES}
    for kind, where in ((Tick, ()), (Snapshot, ("snapshot",)), (Wish, ("wish",)), (Verdict, ("snapshot", "verdict"))):
        for name in kind.__struct_fields__:
            assert any(place[: len(where) + 1] == (*where, name) for place in places), (kind, name)
    assert {("wish", "exchange"), ("wish", "supervised"), ("snapshot", "sensed", "drives", 0, "jumps")} <= places
    assert {("snapshot", "sensed", "scans", 0, name) for name in Scan.__struct_fields__} <= places


def test_the_same_tick_is_the_same() -> None:
    assert replayed(WHOLE, made(Tick)) is None


@pytest.mark.parametrize("name", Tick.__struct_fields__)
def test_a_replay_notices_a_change_of_every_field(name: str) -> None:
    of_this = [(place, other) for place, other in CHANGES if place[0] == name]
    assert of_this
    for place, other in of_this:
        found = replayed(WHOLE, other)
        shown = place[: place.index(0)] if 0 in place else place  # a list is shown whole
        assert found is not None, place
        assert ".".join(map(str, shown)) in found, place
        assert replayed(other, WHOLE) is not None, place
        assert replayed(other, other) is None, place


def test_a_mode_that_sends_no_set_points_does_not_replay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = run(write_mission(tmp_path, [CALIBRATE, follow(0.2)]))
    assert seen.outcome is not None
    recording, step = Recording(seen.outcome.run.path), FollowMode.step
    assert replay(recording, core_from(load_mission(seen.mission))).difference is None
    for silent in ({"exchange": False}, {"supervised": False}):
        monkeypatch.setattr(FollowMode, "step", lambda mode, given, told=silent: replace(step(mode, given), **told))
        found = replay(recording, core_from(load_mission(seen.mission))).difference
        assert found is not None
        assert f"wish.{next(iter(silent))}: recorded True, now False" in found
