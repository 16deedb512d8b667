"""Bytes of standard ROS messages, by the package rosbags: the only file that imports it, and only where it is used."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

TRIGGER_MD5 = "937c9679a518e3a18d831e57125ea522"
"""Of the service std_srvs/Trigger (`rossrv md5 std_srvs/Trigger`)."""
STORES = {
    "humble": "ROS2_HUMBLE",
    "iron": "ROS2_IRON",
    "jazzy": "ROS2_JAZZY",
    "kilted": "ROS2_KILTED",
}
"""Distributions of ROS 2, and what rosbags calls their types."""
Content = Mapping[str, Any]
"""A message: values by the names of its fields; a message in it is such a mapping itself."""
Field = list[str | int]
"""The type of a field; of several values also how many, 0: any number."""

_BESIDE = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
    "float32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "Header header\nAckermannDrive drive\n",
}
"""Definitions of types that rosbags does not bring for ROS 1."""
_BESIDE_2 = {
    "ackermann_msgs/msg/AckermannDrive": _BESIDE["ackermann_msgs/msg/AckermannDrive"],
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nAckermannDrive drive\n",
}
"""And for ROS 2."""
_NUMBERS = {"bool": "?", "byte": "i1", "char": "u1", "octet": "u1"}
_ZERO = {"string": "", "wstring": "", "bool": False, "float32": 0.0, "float64": 0.0}


def ros1_name(type: str) -> str:
    """How ROS 1 writes a type: `nav_msgs/Odometry` for `nav_msgs/msg/Odometry`."""
    return type.replace("/msg/", "/")


class RosTypes(ABC):
    """Message types, written as `nav_msgs/msg/Odometry`."""

    def __init__(self, store: str, beside: Mapping[str, str]) -> None:
        """`store` of rosbags, and definitions `beside` it."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._store = get_typestore(Stores[store])
        for name, text in beside.items():
            self._store.register(get_types_from_msg(text, name))
        self._builders: dict[str, Callable[[Content], object]] = {}

    def pack(self, type: str, content: Content) -> bytes:
        """The bytes of a message; fields that are not given are zero or empty.

        Raises:
            ValueError: it has a field that its type has not.
        """
        return bytes(self._packed(self._builder(type)(content), type))

    def unpack(self, type: str, data: bytes) -> object:
        """A message from its bytes; its fields are attributes.

        Raises:
            ValueError: they are not such a message.
        """
        from rosbags.serde import SerdeError

        try:
            return self._unpacked(data, type)
        except (SerdeError, IndexError, UnicodeDecodeError, AssertionError, struct.error) as error:
            raise ValueError(f"{len(data)} bytes that are no {ros1_name(type)}") from error

    def prepare(self, type: str) -> None:
        """Have all that `pack` and `unpack` need of a type: that takes longer than a tick may wait."""
        self.unpack(type, self.pack(type, {}))

    @abstractmethod
    def _packed(self, message: object, type: str) -> bytes | memoryview:
        """The bytes of what `_made_builder` makes."""

    @abstractmethod
    def _unpacked(self, data: bytes, type: str) -> object:
        """A message from its bytes; raises as rosbags does."""

    def _builder(self, type: str) -> Callable[[Content], object]:
        if (builder := self._builders.get(type)) is None:
            builder = self._builders[type] = self._made_builder(type)
        return builder

    def _made_builder(self, type: str) -> Callable[[Content], object]:
        """Makes what rosbags takes for a message of a type."""
        kind: Any = self._store.types[type]
        parts = [(name, self._part(field)) for name, field in self._store.fielddefs[type][1]]
        known = {name for name, _ in parts}

        def build(content: Content) -> object:
            if not content.keys() <= known:
                raise ValueError(f"{type} has no field {', '.join(sorted(content.keys() - known))}")
            return kind(*[part(content.get(name)) for name, part in parts])

        return build

    def _part(self, field: Any) -> Callable[[Any], object]:  # noqa: ANN401 (rosbags' description of a field)
        import numpy as np
        from rosbags.interfaces import Nodetype

        node, of = field
        if node == Nodetype.BASE:
            zero = _ZERO.get(of[0], 0)
            return lambda value: zero if value is None else value
        if node == Nodetype.NAME:
            build = self._builder(of)
            return lambda value: build({} if value is None else value)
        (inner, name), count = of
        count = count if node == Nodetype.ARRAY else 0
        if inner == Nodetype.NAME:
            each = self._builder(name)
            return lambda values: [each(value) for value in values or ()]
        if name[0] in ("string", "wstring"):
            return lambda values: list(values or ())
        kind = np.dtype(_NUMBERS.get(name[0], name[0]))
        return lambda values: np.zeros(count, kind) if values is None else np.asarray(values, kind)


class Ros1Types(RosTypes):
    """Those of ROS 1 (noetic)."""

    def __init__(self) -> None:
        super().__init__("ROS1_NOETIC", _BESIDE)

    def definition(self, type: str) -> tuple[str, str]:
        """The full text of a type's definition, and its MD5 sum."""
        return self._store.generate_msgdef(type, ros_version=1)

    def prepare(self, type: str) -> None:
        """The definition, too."""
        self.definition(type)
        super().prepare(type)

    def _packed(self, message: object, type: str) -> bytes | memoryview:
        return self._store.serialize_ros1(message, type)

    def _unpacked(self, data: bytes, type: str) -> object:
        return self._store.deserialize_ros1(data, type)


class Ros2Types(RosTypes):
    """Those of a distribution of ROS 2, as CDR with its four bytes of encapsulation."""

    def __init__(self, distribution: str) -> None:
        """`distribution`: a key of `STORES`."""
        super().__init__(STORES[distribution], _BESIDE_2)

    def definition(self, type: str) -> str:
        """The full text of a type's definition."""
        return self._store.generate_msgdef(type, ros_version=2)[0]

    def hash(self, type: str) -> str:
        """The type's hash, as discovery publishes it since Iron (REP 2016): RIHS01_ and 64 digits."""
        return self._store.hash_rihs01(type)

    def fields(self, type: str) -> dict[str, list[tuple[str, Field]]]:
        """The fields of a type and of all types within, each after those that it contains."""
        from rosbags.interfaces import Nodetype

        found: dict[str, list[tuple[str, Field]]] = {}

        def described(field: Any) -> Field:  # noqa: ANN401 (rosbags' description of a field)
            node, of = field
            if node == Nodetype.BASE:
                return [of[0]]
            if node == Nodetype.NAME:
                found.update({name: kept for name, kept in self.fields(of).items() if name not in found})
                return [of]
            return [*described(of[0]), of[1] if node == Nodetype.ARRAY else 0]

        listed = [(name, described(field)) for name, field in self._store.fielddefs[type][1]]
        return {**found, type: listed}

    def _packed(self, message: object, type: str) -> bytes | memoryview:
        return self._store.serialize_cdr(message, type)

    def _unpacked(self, data: bytes, type: str) -> object:
        return self._store.deserialize_cdr(data, type)
