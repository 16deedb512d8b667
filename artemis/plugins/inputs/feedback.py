"""What an operator feels and sees of the robot in the device in his hand: a stop, and a force that centres a wheel.

Devices take their time. They are asked in a thread beside the ticks, which is only handed what is to be felt.
"""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from artemis.devices.evdev.effects import Motors, find_motors
from artemis.devices.hid.port import HidInfo
from artemis.devices.hid.reader import HidReader
from artemis.errors import DeviceLost
from artemis.plugins.observing import Beside
from artemis.values import Mode, Tick

STOPPED = frozenset({Mode.QUICKSTOP, Mode.FAULT})
STEPS = 20
"""So many strengths of the force there are: a wheel is not asked for one more often than it can be felt."""
PATIENCE = 0.5
"""The thread has this long to end [s]."""
FindMotors = Callable[[HidInfo], Motors | None]


class Feedback:
    """Of one input, whatever device it reads. All methods are called by the thread of the ticks."""

    def __init__(
        self, rumble: bool, force: float, top_speed: float, find: FindMotors | None = None, threaded: bool = True
    ) -> None:
        """Begin, without a device.

        Args:
            rumble: The device hums, or is shaken, when the robot stops, and its lamps are on until it may drive again.
            force: Share of its force by which a wheel is shaken, and centred at `top_speed`, in [0, 1].
            top_speed: [m/s]
            find: Finds the motors of a device; None: those that the kernel shows, or none without a thread.
            threaded: Without, devices are asked at once.
        """
        self._rumble, self._force, self._top_speed = rumble, force, top_speed
        self._find = find or (find_motors if threaded else lambda info: None)
        self._beside: Beside[float] | None = None
        if rumble or force > 0:
            self._beside = Beside("force feedback", self._centre, threaded=threaded, bound=1)
        self._infos: list[HidInfo] = []  # this and the next belong to the thread
        self._motors: Motors | None = None
        self._problems: deque[str] = deque()
        self._stopped: Mode | None = None
        self._step = 0

    def take(self, infos: Iterable[HidInfo | None]) -> None:
        """From now on these devices are in the hands."""
        self._step = 0
        if self._beside is not None:
            self._beside.order(self._hold, [info for info in infos if info is not None])
            if self._stopped is not None:  # it was stopped without them
                self._beside.order(self._light)

    def show(self, tick: Tick) -> str:
        """Have what the tick did felt; what went wrong since the last call, else nothing."""
        if self._beside is None:
            return ""
        stopped = tick.mode if tick.mode in STOPPED else None
        if stopped != self._stopped:
            self._beside.order(self._tell, stopped is not None)
        self._stopped = stopped
        speed = abs(tick.snapshot.odometry.speed)
        step = round(STEPS * min(speed / self._top_speed, 1.0)) if self._force > 0 else 0
        if step != self._step:
            self._step = step
            self._beside.put(self._force * step / STEPS)
        return self._problems.popleft() if self._problems else ""

    def close(self) -> None:
        """Let go of the device, its force at nothing; harmless when repeated."""
        if self._beside is not None:
            self._beside.order(self._let_go)
            self._beside.close(PATIENCE)
            self._beside = None

    # ------------------------------------------------------------------------------------------ in the thread

    def _hold(self, infos: list[HidInfo]) -> None:
        self._let_go()
        self._infos = infos

    def _centre(self, force: float) -> None:
        motors = self._opened()
        if motors is not None and motors.centres:
            self._try(lambda: motors.centre(force))

    def _tell(self, stopped: bool) -> None:
        if not self._rumble or (motors := self._opened()) is None:
            return

        def tell() -> None:
            motors.light(stopped)
            if stopped and motors.rumbles:
                motors.rumble()
            elif stopped and motors.shakes and self._force > 0:
                motors.shake(self._force)

        self._try(tell)

    def _light(self) -> None:
        if self._rumble and (motors := self._opened()) is not None:
            self._try(lambda: motors.light(True))

    def _opened(self) -> Motors | None:
        """The motors, opened when they are needed first: a device that was just plugged in may not be permitted yet.

        That they are missing is no news, unless a force was asked for.
        """
        infos, self._infos = self._infos, []
        problems = []
        for info in infos:
            try:
                self._motors = self._motors or self._find(info)
            except DeviceLost as error:
                problems.append(str(error))
        if infos and self._force > 0 and (self._motors is None or not self._motors.centres):
            missing = f"{' and '.join(map(str, infos))}: no force that could centre it"
            self._problems.append("; ".join(problems) or missing)
        return self._motors

    def _try(self, act: Callable[[], None]) -> None:
        """A device that refuses is left alone; one that is gone is no news here."""
        try:
            act()
        except OSError as error:
            if error.errno != errno.ENODEV:
                self._problems.append(f"the device does not take an effect ({error.strerror})")
            self._close()

    def _let_go(self) -> None:
        self._infos = []
        if self._force > 0:
            self._centre(0.0)
        if self._rumble and self._motors is not None:
            self._try(partial(self._motors.light, False))
        self._close()

    def _close(self) -> None:
        if self._motors is not None:
            self._motors.close()
            self._motors = None


class FeltDevices:
    """The devices of an input, and what is felt in them."""

    _readers: Mapping[str, HidReader]
    _feedback: Feedback
    _felt: tuple[int, ...] = ()

    def show(self, tick: Tick) -> str:
        """Have felt what the robot does, in devices with motors; what went wrong with that, else nothing."""
        generations = tuple(reader.generation for reader in self._readers.values())
        if generations != self._felt and all(generations):
            self._felt = generations
            self._feedback.take(reader.info for reader in self._readers.values())
        return self._feedback.show(tick)

    def close(self) -> None:
        """Give the devices back; harmless when repeated."""
        self._feedback.close()
        for reader in self._readers.values():
            reader.close()
