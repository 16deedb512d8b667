"""Parameters of a simulated EPOS that outlast its power: store (0x1010), restore (0x1011), load at start."""

from __future__ import annotations

from collections.abc import Callable, Collection

from artemis.sim.dictionary import AbortCode, AccessRefused, Dictionary, key_of
from artemis.sim.epos_pdo import ProcessData

SAVE = 0x65766173
LOAD = 0x64616F6C
PROCESS_DATA = range(0x1400, 0x1B00)
"""PDO parameters and mappings: what a communication reset of the first generation loads again."""
SENSOR_HALL, MOTOR_BLOCK = 3, 11


class ParameterMemory:
    """The non-volatile memory of one drive."""

    def __init__(
        self,
        dictionary: Dictionary,
        *,
        volatile: Collection[int],
        communication: Collection[int] = PROCESS_DATA,
        restores: Collection[int] = (1,),
        restore_at_once: bool = True,
    ) -> None:
        """Remember nothing yet.

        Args:
            dictionary: The drive's objects as they leave the factory.
            volatile: Indices of writable objects that are not kept.
            communication: Indices that a communication reset loads again.
            restores: Sub-indices of object 0x1011 that restore everything.
            restore_at_once: Whether restored defaults act before a restart.
        """
        self._dictionary = dictionary
        self._communication = communication
        self._restore_at_once = restore_at_once
        self._keys = [
            entry.key for entry in dictionary.entries.values() if entry.access == "rw" and entry.index not in volatile
        ]
        self._defaults = dict(dictionary.values)
        self._stored: dict[int, int] = {}
        checks, written = dictionary.checks, dictionary.written
        checks[key_of(0x1010, 1)] = _judge_signature(SAVE)
        written[key_of(0x1010, 1)] = lambda _: self._store()
        for sub in restores:
            checks[key_of(0x1011, sub)] = _judge_signature(LOAD)
            written[key_of(0x1011, sub)] = self._restorer(key_of(0x1011, sub))

    def restore_identifiers(self, pdos: ProcessData, node_id: int) -> None:
        """Give the drive object 0x1011:5, which sets the COB-IDs of `pdos` back to those of the node."""

        def restore(_: int) -> None:
            pdos.restore_identifiers(node_id)
            self._dictionary.values[key_of(0x1011, 5)] = self._defaults[key_of(0x1011, 5)]

        self._dictionary.checks[key_of(0x1011, 5)] = _judge_signature(LOAD)
        self._dictionary.written[key_of(0x1011, 5)] = restore

    def load(self) -> None:
        """Power-up or node reset: everything as it was stored last, what is not stored as from the factory."""
        self._dictionary.values.update(self._defaults)
        self._dictionary.values.update(self._stored)

    def load_communication(self) -> None:
        """Communication reset: the objects of communication as they were stored last."""
        for key, default in self._defaults.items():
            if key >> 8 in self._communication:
                self._dictionary.values[key] = self._stored.get(key, default)

    def _store(self) -> None:
        self._dictionary.values[key_of(0x1010, 1)] = self._defaults[key_of(0x1010, 1)]  # the signature is no value
        self._stored = {key: self._dictionary.values[key] for key in self._keys}

    def _restorer(self, key: int) -> Callable[[int], None]:
        def restore(_: int) -> None:
            self._restore()
            self._dictionary.values[key] = self._defaults[key]  # the signature is no value

        return restore

    def _restore(self) -> None:
        """Nothing is stored any more; defaults take effect at once in the first generation, else with a restart.

        CiA 301 (object 0x1011, sub-index 1) has the restored defaults set valid by Reset Node or a power cycle; stored
        values that came back then would undo the restore. That they act before is inferred: the firmware specification
        (14.9) allows the restore only while the power stage is disabled, as changes of motor and sensor, and names
        store and restart for the identifiers of sub-index 5 alone.
        """
        self._stored = {}
        for key in self._keys if self._restore_at_once else ():
            default = self._defaults[key]
            if self._dictionary.values[key] != default:
                self._dictionary.poke(key >> 8, key & 0xFF, default)


def _judge_signature(signature: int) -> Callable[[int], None]:
    def judge(value: int) -> None:
        if value != signature:
            raise AccessRefused(AbortCode.CANNOT_STORE)

    return judge


def judge_motor_and_sensor(dictionary: Dictionary) -> None:
    """Tie motor type and sensor type: halls only (3) need a block-commutated motor (11), and keep it one."""

    def judge_sensor(sensor: int) -> None:
        if sensor == SENSOR_HALL and dictionary.number(0x6402) != MOTOR_BLOCK:
            raise AccessRefused(AbortCode.INCOMPATIBLE)

    def judge_motor(motor: int) -> None:
        if motor != MOTOR_BLOCK and dictionary.number(0x2210, 2) == SENSOR_HALL:
            raise AccessRefused(AbortCode.INCOMPATIBLE)

    dictionary.checks[key_of(0x2210, 2)] = judge_sensor
    dictionary.checks[key_of(0x6402, 0)] = judge_motor
