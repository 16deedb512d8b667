"""`artemis calibrate gains`: shows the regulator gains of the drives, tries others, and keeps them if wanted."""

from __future__ import annotations

import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from artemis import clock
from artemis.app import Outcome
from artemis.commands.devices import open_bus
from artemis.commands.gains_trial import DISTANCE, Findings, GainsWatch, Trial, findings, table, write_mission
from artemis.commands.run import run_in_sight
from artemis.commands.terminal import confirmed
from artemis.devices.memory import read_gains, store, with_observer
from artemis.drive_schema import Gains, SiGains
from artemis.errors import ConfigError, DeviceError, RecordingError, shown
from artemis.mission.actions import NewGains
from artemis.mission.gains import check_gains, gains_key, merged
from artemis.mission.loading import LoadedMission, load_mission
from artemis.planning import check_drivable, is_simulated
from artemis.recording.mcap_reader import Recording
from artemis.report.drawing import check_figures
from artemis.report.responses import SLOWEST, SPEED_DISTANCE
from artemis.states.gains import words_of
from artemis.values import JobKind
from artemis.yaml_edit import Keys, edit, edited
from artemis.yaml_file import Data, read

STEPS = {"steering": (0.5, 20.0), "traction": (SLOWEST, 0.2)}
"""Smallest and largest: [degrees], [m/s]."""
USUAL = {"steering": 5.0, "traction": 0.2}
FAILED, INTERRUPTED = 1, 128 + signal.SIGINT
_KINDS = {"current": "P,I", "velocity": "P,I", "position": "P,I,D"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What the command was asked for, in the words of its options."""

    drives: Sequence[str] = ()
    gains: Mapping[str, str]
    """`P,I` or `P,I,D` by `current`, `velocity`, `position`; those that were given."""
    tried: bool = False
    """Try also where no gains are given."""
    step: float | None = None
    yes: bool = False
    simulate: bool = False

    @property
    def moves(self) -> bool:
        """Whether anything is to be tried."""
        return self.tried or bool(self.gains)


def calibrate_gains(mission: Path, wanted: Wanted) -> int:
    """Show gains, or try some and keep them if a person says so. Returns the exit status.

    Raises:
        ConfigError: the mission is refused, or the options are wrong; nothing has moved.
        DeviceError: the bus cannot be opened; nothing has moved.
        RecordingError: the run's folder cannot be made; nothing has moved.
    """
    loaded = load_mission(mission)
    simulated = is_simulated(loaded, wanted.simulate)
    if not wanted.moves:
        return _show(loaded, wanted, simulated)
    check_figures("calibrate gains")
    check_drivable(loaded, mission, simulated)
    trial = trial_from(loaded, wanted)
    if not (simulated or wanted.yes) and not confirmed("calibrate gains", f"{announced(trial)}: go?"):
        say("nothing was moved")
        return FAILED
    status, found, _ = attempt(loaded, mission, trial, wanted.simulate)
    if status or trial.new is None or found is None:
        return status
    if simulated:
        say("kept        nothing: simulated drives do not know what gains do to a machine")
        return 0
    return decide(loaded, trial, found, wanted.yes)


def attempt(
    loaded: LoadedMission, mission: Path, trial: Trial, simulate: bool, predicted: Findings | None = None
) -> tuple[int, Findings | None, Outcome]:
    """Run a trial and tell what it shows: the exit status, 0 only where all of it was seen and is as it was before.

    `predicted`: is shown between what was measured of both gains.

    Raises:
        ConfigError: the mission is refused; nothing has moved.
        DeviceError: the bus cannot be opened; nothing has moved.
    """
    watch = GainsWatch()
    with tempfile.TemporaryDirectory() as folder:
        made, source = write_mission(loaded, mission, trial, Path(folder))
        outcome = run_in_sight(made, source, simulate, watch=watch.see)
    try:
        found = findings(Recording(outcome.run.path), trial)
        if predicted is not None and set(trial.places) <= set(found.responses):
            found = replace(
                found,
                traces={"now": found.traces["now"], **predicted.traces, "new": found.traces["new"]},
                responses={"now": found.responses["now"], **predicted.responses, "new": found.responses["new"]},
            )
        _tell(loaded, trial, found, outcome)
    except RecordingError as error:  # the disk failed
        say(f"kept        nothing: {error}")
        return outcome.exit_status or FAILED, None, outcome
    finally:
        _tell_gains(trial, watch)
    if outcome.exit_status or watch.stopped:
        say("trial       aborted: nothing is kept")
        return outcome.exit_status or FAILED, found, outcome
    if problem := _unproven(trial, watch, found, outcome):
        say(f"{'trial       not whole' if trial.new is None else 'kept        nothing'}: {problem}")
        return FAILED, found, outcome
    return 0, found, outcome


# ---------------------------------------------------------------------------------------------- what is asked for


def trial_from(loaded: LoadedMission, wanted: Wanted) -> Trial:
    """The trial that the options mean.

    Raises:
        ConfigError: everything that is wrong with them.
    """
    known = loaded.robot.drives
    problems: list[str] = []
    new = _new_gains(wanted.gains, problems)
    names = tuple(dict.fromkeys(wanted.drives))
    asked = new if new is not None else NewGains.model_construct()
    problems += [
        f"--drive {shown(name)}: {text}" for name, text in check_gains(dict.fromkeys(names, asked), loaded.robot)
    ]
    if not names:
        problems.append(f"--drive is missing: name one of {', '.join(known)}, or several of one kind")
    found = [known[name] for name in names if name in known]
    roles = {drive.role for drive in found}
    if len({drive.tables.gain_scale for drive in found}) > 1:
        problems.append("--drive: the gains of these drives have different units: try one family after the other")
    if len(roles) > 1:
        problems.append("--drive: steering and traction drives are tried one kind after the other")
    role = min(roles, default="steering")
    step = USUAL[role] if wanted.step is None else wanted.step
    low, high = STEPS[role]
    if roles and not low <= step <= high:
        unit = "degrees" if role == "steering" else "m/s"
        problems.append(f"--step {step:g}: expected {low:g} to {high:g} {unit}")
    if (
        new is not None
        and not problems
        and all(merged_gains(loaded, name, new) == known[name].known_gains for name in names)
    ):
        problems.append("these are the gains of the robot file already; to see how the drives follow with them: --try")
    if problems:
        raise ConfigError([f"calibrate gains: {problem}" for problem in problems])
    return Trial(drives=names, role=role, side=known[names[0]].side, step=step, new=new)


def _new_gains(words: Mapping[str, str], problems: list[str]) -> NewGains | None:
    """The gains of the options; None where there are none, or they are wrong."""
    gains: dict[str, tuple[float, ...]] = {}
    for kind, text in words.items():
        form = _KINDS[kind]
        try:
            gains[kind] = tuple(float(word) for word in text.split(","))
            NewGains.model_validate({kind: gains[kind]})
        except ValueError:  # a ValidationError is one
            count = form.count(",") + 1
            problems.append(f"--{kind} {shown(text)}: expected {form}: {count} numbers as the robot file has them")
    return NewGains.model_validate(gains) if gains and not problems else None


def merged_gains(loaded: LoadedMission, name: str, new: NewGains | None) -> Gains | SiGains:
    """Gains of a drive that has some in the robot file, with the new ones."""
    known = loaded.robot.drives[name].known_gains
    assert known is not None
    return known if new is None else merged(new, known)


def _words(loaded: LoadedMission, name: str, new: NewGains | None) -> str:
    return words_of(loaded.robot.drives[name].tables.told_gains(merged_gains(loaded, name, new).numbers))


def announced(trial: Trial) -> str:
    """What will move."""
    who, times = (
        ", ".join(trial.drives),
        "once with the gains of the robot file" + ", once with the new ones" * bool(trial.new),
    )
    if trial.role == "steering":
        return f"{who}: the robot stands, its wheels turn by {trial.step:g} degrees to the left and back, {times}"
    return f"{who}: the robot drives {DISTANCE:g} m straight ahead and back at {trial.step:g} m/s, {times}"


# ---------------------------------------------------------------------------------------------- showing


def _show(loaded: LoadedMission, wanted: Wanted, simulated: bool) -> int:
    """Print the gains of the drives as they are found, beside the robot file's."""
    if wanted.step is not None or wanted.yes:
        raise ConfigError("calibrate gains: --step and --yes are for a trial: give gains, or --try")
    for name, problem in check_gains(dict.fromkeys(wanted.drives, NewGains.model_construct()), loaded.robot):
        if name not in loaded.robot.drives:
            raise ConfigError(f"calibrate gains: --drive {shown(name)}: {problem}")
    read, observed = clock.run(_read(loaded, simulated), simulated=simulated)
    drives = {name: gains for name, gains in read.items() if not wanted.drives or name in wanted.drives}
    say(f"gains of {loaded.robot.robot} in the robot file, and in the drives{' (simulated)' * simulated} now")
    width = 16 if any(loaded.robot.drives[name].tables.gains_in_si for name in drives) else 14
    say(f"{'':16}{'':12}{'current P,I':{width}}{'velocity P,I':{width}}position P,I,D")
    differs = False
    for name, found in drives.items():
        family, numbers = loaded.robot.drives[name].tables, loaded.robot.drives[name].gain_numbers
        if not family.gains:
            say(f"{name:16}not known of a {family.title}: the maker's own tool shows them")
            continue
        file = family.told_gains(numbers) if numbers else None
        gains = found if isinstance(found, str) else family.told_gains(found)
        said = loaded.robot.drives[name].si_gains
        words = _observer(said is not None and said.observer)
        say(f"{name:16}{'robot file':12}{'none' if file is None else _columns(file, width) + words}")
        if isinstance(gains, str):
            say(f"{'':16}{'drive':12}{gains}")
            continue
        other = said is not None and said.observer != (name in observed)
        words = _observer(name in observed, other)
        say(f"{'':16}{'drive':12}{_columns(gains, width, file)}{words}")
        differs = differs or other or file not in (None, gains)
    if differs:
        say("* differs. A drive has what was stored in it when its power came; each run writes the robot file's gains")
    return int(any(isinstance(gains, str) for gains in drives.values()))


def _observer(has: bool, differs: bool = False) -> str:
    """The structure of the velocity regulator, as it stands beside the gains in the robot file: a low pass is usual."""
    return f"  observer: {str(has).lower()}{' *' * differs}" if has or differs else ""


async def _read(loaded: LoadedMission, simulated: bool) -> tuple[dict[str, tuple[int, ...] | str], frozenset[str]]:
    """Gains of the drives, and those of them whose velocity regulator has an observer."""
    with closing(open_bus(loaded, simulated)) as bus:
        return await read_gains(loaded.robot, bus), await with_observer(loaded.robot, bus)


def _columns(gains: tuple[float, ...], width: int, known: tuple[float, ...] | None = None) -> str:
    parts = [slice(0, 2), slice(2, 4), slice(4, 7)]
    words = [
        ",".join(map(str, gains[part])) + " *" * (known is not None and gains[part] != known[part]) for part in parts
    ]
    return "".join(f"{word:{width - 1}} " for word in words).rstrip()


# ---------------------------------------------------------------------------------------------- after the trial


def _tell(loaded: LoadedMission, trial: Trial, found: Findings, outcome: Outcome) -> None:
    """Numbers and figure."""
    say("")
    if found.responses:
        gains = {
            label: {name: _words(loaded, name, new) for name in trial.drives}
            for label, new in (("now", None), ("predicted", trial.new), ("new", trial.new))
        }
        for line in table(found, trial, gains):
            say(line)
        figure = outcome.run.path / "gains.png"
        _draw(found, figure)
        say(f"figure      {figure}")
    if trial.role == "traction":
        distance = 1000.0 * SPEED_DISTANCE
        say(
            f"            speeds are means over {distance:.0f} mm, the counts are so coarse: faster swings are not seen"
        )
    say("            the current is sampled once a tick: what its own regulator does in a millisecond is not seen")
    if missing := [label for label in trial.places if label not in found.responses]:
        say(f"trial       nothing was seen of the gains {' and '.join(missing)}")


def _tell_gains(trial: Trial, watch: GainsWatch) -> None:
    """Which gains the drives have now."""
    for name, why in watch.unrestored.items():
        say(f"WARNING     {name} may have the gains on trial while it has power ({why}); the next run writes its own")
    if restored := [name for name in trial.drives if name in watch.restored]:
        say(f"restored    {', '.join(restored)}: the gains of the robot file")


def _draw(found: Findings, file: Path) -> None:
    from artemis.report.figures import style
    from artemis.report.responses import response_figure

    try:
        with style():
            response_figure(found.traces).savefig(file, facecolor="white", dpi=120)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be written: {error.strerror}") from error


def _unproven(trial: Trial, watch: GainsWatch, found: Findings, outcome: Outcome) -> str:
    """Why nothing can be kept, whoever wants it; empty: all was tried and recorded whole, and is as it was before."""
    if lacks := (*outcome.troubles, *([found.missing] if found.missing else ())):
        return f"the trial was not recorded whole: {lacks[0]}"
    if not set(trial.places) <= set(found.responses):
        return "not all of the trial was seen"
    if trial.new is not None and (left := [name for name in trial.drives if name not in watch.restored]):
        return f"{', '.join(left)} did not take the robot file's gains back"
    return ""


def decide(loaded: LoadedMission, trial: Trial, found: Findings, yes: bool) -> int:
    """Keep the new gains or not, as a person says, or `--yes` does of drives that settled."""
    file = loaded.folder / loaded.mission.robot
    if yes and not found.settled:
        say("kept        nothing: a drive did not settle with the new gains")
        return FAILED
    question = f"keep the new gains: in {file}, and stored in {', '.join(trial.drives)}?"
    if not yes and not confirmed("calibrate gains", question):
        say("kept        nothing: the robot file is as it was")
        return 0
    return _keep(loaded, file, {name: merged_gains(loaded, name, trial.new) for name in trial.drives})


def _keep(loaded: LoadedMission, file: Path, new: Mapping[str, Gains | SiGains]) -> int:
    """Store gains in their drives, then write them into the robot file; if one fails, tell what is where."""
    known = loaded.files[loaded.mission.robot]
    changes: dict[Keys, Data] = {
        ("drives", name, gains_key(loaded.robot.drives[name])): gains.model_dump(mode="json")
        for name, gains in new.items()
    }
    kept: list[str] = []
    status = FAILED
    try:
        if read(file) != known:
            raise ConfigError(f"{file}: was changed meanwhile, run again")
        edited(known, str(file), changes)  # what cannot be written is not stored
        clock.run(_store(loaded, new, file, changes, kept), simulated=False)
        status = 0
    except (DeviceError, ConfigError) as error:
        problem = str(error)
    except KeyboardInterrupt:
        status, problem = INTERRUPTED, "interrupted"
    if str(file) in kept:
        say(f"kept        {', '.join(new)}: stored, and in {file}")
        return status
    say(f"kept        {'not all' if kept else 'nothing'}: {problem}")
    if kept:
        say(f"            {', '.join(kept)}: stored")
    if status == INTERRUPTED and len(kept) < len(new):
        say(f"            {next(name for name in new if name not in kept)}: may have stored them, it was about to")
    if kept or status == INTERRUPTED:
        say(f"            {file}: has the old gains still, and each run writes those")
    return status


async def _store(
    loaded: LoadedMission, new: Mapping[str, Gains | SiGains], file: Path, changes: Mapping[Keys, Data], kept: list[str]
) -> None:
    """`kept` gets the name of what has the new gains: drives, and at last the file."""
    numbers = {name: gains.numbers for name, gains in new.items()}
    with closing(open_bus(loaded, simulated=False)) as bus:
        await store(loaded.robot, bus, JobKind.WRITE_GAINS, numbers, kept.append)
    edit(file, changes)  # here, where an interrupt comes before or after it
    kept.append(str(file))


def say(text: str) -> None:
    """A line for the person at the terminal."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
