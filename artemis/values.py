"""Frozen values that cross layers. Plain SI inside: m, s, rad, m/s, A, V; left and counter-clockwise positive.

One tick in the order of its values: `Sensed` (all that the edge knows) -> `Snapshot` (with the pose) -> `Verdict`
-> `Wish` of the mode -> `SetPoints` after the gate -> `Tick` (the record of it all).

Those with a field that may be None are recorded without what has its default; who reads them makes it again.
"""

from __future__ import annotations

from enum import Enum, IntEnum

from msgspec import Struct

from artemis.battery import BatteryState
from artemis.drive_states import DriveState, Goal, Nmt
from artemis.progress import Acted, MissionEvent, Position, TypedAnswer
from artemis.scan import Clearance, Scan


class DriveFeedback(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What one drive last said. Ages are seconds; None means never heard in this run."""

    name: str
    state: DriveState = DriveState.UNKNOWN
    statusword: int = 0
    position: float = 0.0
    """Traction: metres rolled since power-up (unwrapped). Steering: wheel angle [rad], absolute once referenced."""
    velocity: float = 0.0
    """Traction: m/s; steering: rad/s; as the drive measures it (coarse with hall sensors)."""
    current: float = 0.0  # motor current [A], signed
    mode: int = 0  # modes of operation display (object 0x6061)
    potentiometers: tuple[float, float] = (0.0, 0.0)  # both analog inputs [V]; zero for a traction drive
    angle_sensor: int = 0  # counts of an absolute encoder, or digital inputs by their functions, where these measure it
    age: float | None = None  # of the older of the feedback PDOs [s]
    nmt: Nmt | None = None
    heartbeat_age: float | None = None
    emergencies: tuple[int, ...] = ()  # EMCY error codes that arrived since the last tick, oldest first
    boots: int = 0  # boot-up frames since the last tick
    frames: int = 0  # TxPDO 1 since the last tick: one per SYNC
    malformed: int = 0  # frames since the last tick that cannot be what they claim, and were dropped
    disordered: int = 0  # frames since the last tick that were older on the bus than one before, and were dropped
    jumps: int = 0  # positions in a row that no motion explains; each was dropped
    stray: int = 0  # SDO answers since the last tick that nobody waited for, and were dropped
    temperature_c: float | None = None  # of its power stage [°C]; None: not known


class Request(Enum):
    """What an operator or an input device asks for, once."""

    QUICKSTOP = "quick stop"
    ACKNOWLEDGE = "acknowledge"
    ARM = "arm"
    END = "end"
    DONE = "done"
    RECORD = "record path"
    ACCEPT = "accept"
    LEFT_DEGREE, RIGHT_DEGREE = "a degree to the left", "a degree to the right"
    LEFT_TENTH, RIGHT_TENTH = "a tenth of a degree to the left", "a tenth of a degree to the right"


class OperatorInput(Struct, frozen=True, kw_only=True, omit_defaults=True, repr_omit_defaults=True, gc=False):
    """The newest valid sample of one input device. Axes are levels; requests and poses happen once."""

    source: str
    speed: float = 0.0  # wished, of the virtual front wheel [m/s], forward positive
    steering: float = 0.0  # wished angle of the virtual front wheel [rad], left positive
    enabled: bool = False  # the enable button (deadman) is held
    neutral: bool = True  # every axis rests and the enable button is released
    requests: tuple[Request, ...] = ()
    age: float | None = None  # seconds since the sample arrived; None: never
    raw: tuple[float, ...] = ()  # what the device reports of its axes, in its own units
    axes: tuple[float, ...] = ()  # calibrated: each in [-1, 1]
    centred: tuple[float, ...] = ()  # after the deadzone
    shaped: tuple[float, ...] = ()  # after the curve: what becomes speed and steering
    buttons: tuple[bool, ...] = ()
    goal: Pose | None = None  # where the robot shall drive, in the frame `map`: for a step that asks this input
    initial_pose: LocatedPose | None = None  # about where the robot is on the map, as somebody says: for the localizer
    answers: tuple[str, ...] = ()  # to questions of the mission


class JobKind(Enum):
    """What takes longer than a tick; done by the edge, beside the ticks."""

    SECURE = "secure"  # find the drive as it is: identity, state; stop it if it moves; disable it
    HALT = "halt"  # stop and switch off by SDO a drive that no longer takes part in the exchange of process data
    KEEP_OFF = "keep off"  # likewise, again and again, one that takes no part yet; `values` of one that was found on
    CONFIGURE = "configure"  # write the configuration, read it back, arm the heartbeat consumer, start the node
    REFERENCE = "reference"  # the wheel stands at the angle `value` [rad]: count from here; the drive keeps its zero
    CLEAR_TARGET = "clear target"  # write target 0 (traction) or the actual position (steering) and read it back
    READ_HISTORY = "read history"  # read the drive's error history (0x1003)
    READ_STO = "read STO inputs"  # `values` of a drive whose safe torque off is open: what its object for them shows
    READ_CALIBRATION = "read calibration"  # what the drive keeps of its potentiometers (0x200C)
    WRITE_CALIBRATION = "write calibration"  # `values`, read back; STORE keeps them when the power goes
    READ_GAINS = "read gains"  # regulator gains: current P, I; velocity P, I; position P, I, D
    WRITE_GAINS = "write gains"  # likewise
    STORE = "store"  # all parameters of the drive, for ever (0x1010)
    DISARM = "disarm"  # switch the heartbeat consumer off, read it back, enter Pre-Operational
    PLAN = "plan"  # a route for step `value` of the mission, from here; its `values`: of `motion.planned_route`
    FIT = "fit"  # a path through the recorded poses `values` for step `value`, likewise


RESETS = {"": 0.0, "communication": 1.0, "node": 2.0}  # `value` of the job SECURE, by the NMT reset that goes before


class Job(Struct, frozen=True, kw_only=True, gc=False):
    """One order to one drive, or to what plans routes and fits paths; `id` is unique in a run."""

    id: int
    kind: JobKind
    drive: str
    value: float = 0.0
    values: tuple[int, ...] = ()


NOT_KEPT = 0
"""In the values of a job PLAN before a present route that is to be another one although it is free: none begins so."""


class JobResult(Struct, frozen=True, kw_only=True, gc=False):
    """How a job ended. `detail` is for people; `values` for the logic (READ_HISTORY: error codes)."""

    id: int
    kind: JobKind
    drive: str
    ok: bool
    detail: str = ""
    fault: str = ""  # the catalogue's id of what went wrong
    values: tuple[int, ...] = ()


class BusHealth(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What the host's end of the bus went through since the last tick."""

    foreign: tuple[int, ...] = ()  # identifiers that only we may send, heard from somebody else
    refused: int = 0  # most frames in a row that the adapter did not take
    error_frames: int = 0
    blocked: tuple[str, ...] = ()  # frames of ours that the allow-list held back: why, and from where each came


class Sensed(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """Everything the edge knows at a tick. Recording these is enough to replay a run."""

    index: int
    time: float  # run time [s]
    late: float = 0.0  # how long after its time on the schedule the tick began [s]
    sent: float = 0.0  # when the last scheduled tick's frames had been sent [s of the run]
    urgent: bool = False  # an extra tick, off the schedule: writes stop frames only
    attended: bool = False  # somebody can acknowledge and arm; else a stop ends the run, if nobody is awaited
    awaited: bool = False  # somebody may still come who can: where the drives are off, the run waits for them
    drives: tuple[DriveFeedback, ...] = ()
    bus: BusHealth = BusHealth()
    inputs: tuple[OperatorInput, ...] = ()
    requests: tuple[Request, ...] = ()
    results: tuple[JobResult, ...] = ()
    faults: tuple[Fault, ...] = ()  # found by the edge itself: a lost bus, a plugin that raised, a late tick
    fixes: tuple[PoseFix, ...] = ()  # what a localizer found since the last tick
    scans: tuple[Scan, ...] = ()  # of laser scanners, those that are new since the last tick, oldest first
    answers: tuple[str, ...] = ()  # to questions of the mission
    typed: tuple[TypedAnswer, ...] = ()  # likewise, at the terminal
    battery_v: float | None = None  # supply voltage [V]; None: nobody measures it


class Pose(Struct, frozen=True, kw_only=True, gc=False):
    """Where the centre of the REAR axle is: x, y [m] and heading [rad, counter-clockwise from x]."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0


class PoseFix(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """Where a localizer found the robot, in the frame `map`; told at that time or later."""

    time: float  # run time at which the robot was there [s]
    pose: Pose
    covariance: tuple[float, ...]  # as of `LocatedPose`; (): nothing was measured, only quality and doubt are told
    source: str  # the localizer's name
    quality: float = 1.0  # how well what was seen fits the map there, 0 to 1
    doubt: float = 0.0  # 0: sure; 1 and above: lost, the pose means nothing; between: the share of the way there
    common: tuple[float, ...] = ()  # part of the covariance that all fixes near by share: it does not average away


class LocatedPose(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """Where the robot is, by all that is known: the newest fixes of a localizer carried on by the odometry, or this."""

    pose: Pose = Pose()
    frame: str = "odom"  # `map` once a localizer found the robot
    source: str = "odometry"  # or the localizer's name
    age: float | None = None  # of the newest fix that was believed [s]; None: there is none
    covariance: tuple[float, ...] = ()
    """Of x, y, heading in `frame`: xx, xy, x heading, yy, y heading, heading heading [m², m rad, rad²]; (): unknown."""
    lost: bool = False  # the pose means nothing
    unused: int = 0  # fixes so far that came too late, from the future, or were not believed
    contradicted: float = 0.0  # how long fixes have said that the robot is somewhere else, by a jump [s]


class Odometry(Struct, frozen=True, kw_only=True, gc=False):
    """Motion estimated from the wheels, and their pose in the frame `odom` (origin: where the run was armed)."""

    pose: Pose = Pose()
    speed: float = 0.0  # of the virtual front wheel [m/s]
    steering: float = 0.0  # of the virtual front wheel [rad]
    distance: float = 0.0  # distance of the rear axle centre [m], forward positive
    driven: float = 0.0  # the same, but backwards counts as forwards
    slip: float = 0.0  # disagreement of the driven wheels in the last step: how far off the rigid-body fit [m/s]
    lost: bool = False  # driven wheels may have rolled while nobody counted: this pose means nothing
    uncounted: bool = False  # they may have since the tick before: nothing that was near is where it was


class Action(Enum):
    """How a command is meant. The gate passes the last two untouched."""

    RUN = "run"
    QUICKSTOP = "quick stop"
    DISABLE = "disable"


class DriveCommand(Struct, frozen=True, kw_only=True, gc=False):
    """A wish for the vehicle: virtual front wheel speed [m/s] and angle [rad]."""

    speed: float = 0.0
    steering: float = 0.0
    action: Action = Action.RUN


class SetPoints(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What leaves the gate: the virtual wheel, and each wheel's own set-point (rolling speed m/s, angle rad)."""

    speed: float = 0.0
    steering: float = 0.0
    speed_left: float = 0.0
    speed_right: float = 0.0
    steering_left: float = 0.0
    steering_right: float = 0.0
    clearance: Clearance | None = None  # what obstacles left to the robot; None: they do not limit it


class Severity(IntEnum):
    """Reactions from mild to severe; the most severe active one wins."""

    NONE = 0
    WARN = 1
    LIMIT = 2
    CONTROLLED_STOP = 3  # S2: the gate ramps to zero, drives stay enabled
    QUICK_STOP = 4  # S1: the drives' own quick stop, then off
    OFF = 5  # S0: off at once, the robot coasts


_STOPPING = Severity.CONTROLLED_STOP


class Mode(Enum):
    """Robot modes."""

    INIT = "init"
    READY = "ready"
    CALIBRATE = "calibrate"
    TELEOP = "teleop"
    FOLLOW = "follow"
    ACT = "act"
    QUICKSTOP = "quickstop"
    FAULT = "fault"
    END = "end"

    __hash__ = object.__hash__  # as of `DriveState`


class Fault(Struct, frozen=True, kw_only=True, gc=False):
    """Something is wrong: the catalogue's id, the device, and words for the operator."""

    id: str
    severity: Severity
    text: str
    device: str = ""
    to_fault: bool = True  # leads to the mode `fault` (else to `quickstop` from S2 on)
    final: bool = False  # no acknowledgment helps in this run


class Verdict(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """The supervisor's judgement of one tick: every active fault, worst first."""

    severity: Severity = Severity.NONE
    faults: tuple[Fault, ...] = ()
    to_fault: bool = False
    final: bool = False  # one of the faults cannot be acknowledged in this run
    recovers: bool = False  # what stops the robot will be forgotten without a person, once its cause is gone
    resumes: bool = False
    """As `recovers`, and the mission says that the robot may continue by itself then."""
    alarm: bool = False
    """The robot does not stop, whatever is done: only the hardware emergency stop is left."""

    @property
    def stopping(self) -> tuple[Fault, ...]:
        """The faults for which the robot has to come to rest."""
        return tuple(fault for fault in self.faults if fault.severity >= Severity.CONTROLLED_STOP)

    @property
    def stops(self) -> bool:
        """The robot has to come to rest."""
        return self.severity >= _STOPPING

    @property
    def limits(self) -> bool:
        """The robot may continue, slowly."""
        return self.severity is Severity.LIMIT


class Snapshot(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What a mode sees: the sensed values, and what follows from them without judgement."""

    sensed: Sensed
    dt: float  # seconds since the last scheduled tick; 0 in the first, clamped after a pause
    pose: LocatedPose  # where the robot is: what paths and distances are measured by
    odometry: Odometry
    standing: bool  # no driven wheel moved noticeably over the last 100 ms
    set_points: SetPoints  # what left the gate in the last tick
    verdict: Verdict
    battery: BatteryState | None = None  # None: the robot file describes none, or nobody measures its voltage

    @property
    def time(self) -> float:
        """Seconds since the run began."""
        return self.sensed.time


class Event(Enum):
    """What may change the mode; the table is in `states/machine.py`."""

    ALIGNED = "aligned"
    CALIBRATE = "start calibrate"
    TELEOP = "start teleop"
    FOLLOW = "start follow"
    ACT = "start act"
    DONE = "done"
    STOP = "stop"
    FAULT = "fault"
    REARMED = "re-armed"
    ACKNOWLEDGED = "acknowledged"
    END = "end"


class Cause(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """Why a mode began, or began anew."""

    event: Event
    request: Request | None = None  # what somebody asked for, where that is the reason
    faults: tuple[Fault, ...] = ()
    """Those that led there; at the end of a run that no request ended: those that still stop the robot."""


class Tracking(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """How a path is being followed."""

    arc_length: float  # of the projection [m]
    length: float  # of the whole path, all laps [m]
    cross_track: float
    """Signed distance from the path by the estimated pose [m], positive to the left in the direction of travel."""
    heading_error: float = 0.0  # heading of the end that is ahead, minus path tangent [rad]
    planned_speed: float | None = None  # that the path allows here, of the virtual front wheel [m/s]
    feedforward: float | None = None  # steering for the path's curvature alone [rad]; the rest is feedback


class Wish(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What a mode wants of one tick."""

    command: DriveCommand = DriveCommand()
    traction: Goal = Goal.DISABLED
    steering: Goal = Goal.DISABLED
    jobs: tuple[Job, ...] = ()
    heartbeat: bool = True
    """False only while the watchdog is being proven, and after the ordered end."""
    exchange: bool = True  # set-points and SYNC go out; False while listening and configuring
    supervised: bool = True
    """The drives are watched. False in bring-up, which checks for itself, and in the ordered end."""
    event: Event | None = None
    fault: Fault | None = None
    phase: str = ""
    tracking: Tracking | None = None
    reset_pose: bool = False  # make the present place the origin of the odometry
    done: float | None = None
    """How much of the mission's current step is done: distance along its path [m], or time [s]; None: as before."""
    over: bool = False  # all of it is done
    outcome: str = ""  # how the step ended, if it did not end as `over` says
    acted: tuple[Acted, ...] = ()  # what behaviours told: that of the current step, and those beside it
    failed: bool = False  # what the run was to do will not be done, or it cannot end in order
    finished: bool = False  # the ordered end is complete; the run may stop ticking


class Tick(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """The record of one tick, in the order it came about."""

    snapshot: Snapshot
    mode: Mode
    cause: Cause | None = None
    """Why the mode began in this tick, or began anew; None: it lasts."""
    position: Position = Position()
    """Where the mission is after it."""
    events: tuple[MissionEvent, ...] = ()
    """What happened in the mission in this tick."""
    wish: Wish
    failed: bool = False
    """A fault or a stop ended the run before its last step, or a drive did not end normally."""
    set_points: SetPoints
