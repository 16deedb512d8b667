"""Access to the objects of one node, whatever line leads to it: what a drive's jobs are made of."""

from __future__ import annotations

from typing import Protocol

from artemis.devices.can_bus import Frame


class ObjectAccess(Protocol):
    """Reads and writes objects of one node, one at a time; several nodes side by side."""

    late_answers: int
    """Answers that fitted no pending request and were dropped."""

    async def read(self, index: int, subindex: int, size: int = 0) -> bytes:
        """The object's bytes; `size` of them where the line does not tell how many there are (0: all that came).

        Raises:
            SdoAbort: the node refused.
            DeviceTimeout: no answer in all tries.
            ProtocolError: an answer that is none.
            DeviceLost: the line is gone.
        """

    async def write(self, index: int, subindex: int, data: bytes, patience: float | None = None) -> None:
        """Write the object's bytes; returns when the node has confirmed them. Raises as `read` does.

        `patience` [s] is for what takes a node long, and is not to be asked for twice: one try, with so much time.
        """

    def receive(self, frame: Frame) -> None:
        """Take in a CAN frame on the node's SDO answer identifier."""
