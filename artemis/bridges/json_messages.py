"""Standard ROS messages as JSON, both ways; no package of ROS is needed for that.

Each form lists a type's fields, each with the value of a field that is not given: numbers, texts, other
messages; `[form]` are any number of messages, `()` any number of values.
"""

from __future__ import annotations

from math import inf, isfinite
from types import SimpleNamespace
from typing import Any

import msgspec

Form = dict[str, Any]

_TIME: Form = {"sec": 0, "nanosec": 0}
_HEADER: Form = {"stamp": _TIME, "frame_id": ""}
_VECTOR: Form = {"x": 0.0, "y": 0.0, "z": 0.0}
_TURN: Form = {**_VECTOR, "w": 0.0}
_POSE: Form = {"position": _VECTOR, "orientation": _TURN}
_UNCERTAIN: Form = {"pose": _POSE, "covariance": (0.0,) * 36}
_POSE_STAMPED: Form = {"header": _HEADER, "pose": _POSE}
_TWIST: Form = {"linear": _VECTOR, "angular": _VECTOR}
_MOVED: Form = {"translation": _VECTOR, "rotation": _TURN}
_TRANSFORM: Form = {"header": _HEADER, "child_frame_id": "", "transform": _MOVED}
_STATUS: Form = {"level": 0, "name": "", "message": "", "hardware_id": "", "values": [{"key": "", "value": ""}]}
_DRIVE: Form = dict.fromkeys(("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk"), 0.0)

FORMS: dict[str, Form] = {
    "ackermann_msgs/msg/AckermannDrive": _DRIVE,
    "ackermann_msgs/msg/AckermannDriveStamped": {"header": _HEADER, "drive": _DRIVE},
    "diagnostic_msgs/msg/DiagnosticArray": {"header": _HEADER, "status": [_STATUS]},
    "geometry_msgs/msg/PoseStamped": _POSE_STAMPED,
    "geometry_msgs/msg/PoseWithCovarianceStamped": {"header": _HEADER, "pose": _UNCERTAIN},
    "geometry_msgs/msg/Twist": _TWIST,
    "geometry_msgs/msg/TwistStamped": {"header": _HEADER, "twist": _TWIST},
    "nav_msgs/msg/OccupancyGrid": {
        "header": _HEADER,
        "info": {"map_load_time": _TIME, "resolution": 0.0, "width": 0, "height": 0, "origin": _POSE},
        "data": (),
    },
    "nav_msgs/msg/Odometry": {
        "header": _HEADER,
        "child_frame_id": "",
        "pose": _UNCERTAIN,
        "twist": {"twist": _TWIST, "covariance": (0.0,) * 36},
    },
    "nav_msgs/msg/Path": {"header": _HEADER, "poses": [_POSE_STAMPED]},
    "sensor_msgs/msg/BatteryState": {
        "header": _HEADER,
        **dict.fromkeys(("voltage", "temperature", "current", "charge", "capacity", "design_capacity"), 0.0),
        "percentage": 0.0,
        **dict.fromkeys(("power_supply_status", "power_supply_health", "power_supply_technology"), 0),
        "present": False,
        "cell_voltage": (),
        "cell_temperature": (),
        "location": "",
        "serial_number": "",
    },
    "sensor_msgs/msg/JointState": {"header": _HEADER, "name": (), "position": (), "velocity": (), "effort": ()},
    "sensor_msgs/msg/LaserScan": {
        "header": _HEADER,
        **dict.fromkeys(("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time"), 0.0),
        **dict.fromkeys(("range_min", "range_max"), 0.0),
        "ranges": (),
        "intensities": (),
    },
    "std_msgs/msg/Bool": {"data": False},
    "std_msgs/msg/Empty": {},
    "tf2_msgs/msg/TFMessage": {"transforms": [_TRANSFORM]},
}
"""By type. Those of ROS 1 and ROS 2 differ in the names of a time's parts, and in a header's number."""


def full_name(type: str) -> str:
    """How ROS 2 writes a type, and artemis: `nav_msgs/msg/Odometry` also for `nav_msgs/Odometry`."""
    package, *_, kind = type.split("/")
    return f"{package}/msg/{kind}"


class JsonMessages:
    """Packs and unpacks messages."""

    def __init__(self, ros: int = 2) -> None:
        """`ros`: 1 or 2, whose field names times have."""
        self._one = ros == 1

    def prepare(self, type: str) -> None:
        """Nothing has to be."""

    def pack(self, type: str, content: Form) -> bytes:
        """The JSON of a message; fields that are not given are zero or empty. What is no number is null.

        Raises:
            ValueError: it has a field that its type has not.
        """
        return msgspec.json.encode(self._complete(FORMS[type], content), enc_hook=_listed)

    def unpack(self, type: str, data: bytes) -> object:
        """A message from its JSON; its fields are attributes. What is no header is an empty one.

        Raises:
            ValueError: it is no such message.
        """
        try:
            return _understood(FORMS[type], msgspec.json.decode(data))
        except (msgspec.DecodeError, RecursionError) as error:
            raise ValueError(f"{len(data)} bytes that are no JSON") from error

    def _complete(self, form: Any, content: Any) -> Any:  # noqa: ANN401 (any part of a message)
        if form is _TIME and self._one:
            return {"secs": content.get("sec", 0), "nsecs": content.get("nanosec", 0)}
        if isinstance(form, dict):
            if not content.keys() <= form.keys():
                if not (form is _HEADER and "seq" in content):
                    raise ValueError(f"no field {', '.join(sorted(content.keys() - form.keys()))}")
            made = {name: self._part(part, content.get(name)) for name, part in form.items()}
            return {"seq": content.get("seq", 0), **made} if form is _HEADER and self._one else made
        return [self._complete(form[0], each) for each in content] if isinstance(form, list) else content

    def _part(self, form: Any, content: Any) -> Any:  # noqa: ANN401 (any part of a message)
        if content is None:
            content = {} if isinstance(form, dict) else form
            return [] if isinstance(form, list) else self._complete(form, content)
        return self._complete(form, content)


def _listed(value: Any) -> object:  # noqa: ANN401 (of numpy)
    """Arrays as lists; those of distances with as many digits as they have."""
    return value.round(6).tolist() if value.dtype.kind == "f" else value.tolist()


def _understood(form: Any, content: Any, name: str = "message") -> Any:  # noqa: ANN401 (any part of a message)
    if form is _HEADER:
        return _header(content)
    if isinstance(form, dict):
        if not isinstance(content, dict):
            raise ValueError(f"{name} is no message")
        if not content.keys() <= form.keys():
            raise ValueError(f"{name} has no field {', '.join(sorted(content.keys() - form.keys()))}")
        parts = {key: _understood(part, content.get(key, _unset(part)), key) for key, part in form.items()}
        return SimpleNamespace(**parts)
    if isinstance(form, tuple):
        numbers = list(form) if content is form else content
        if not isinstance(numbers, list) or (form and len(numbers) != len(form)):
            raise ValueError(f"{name} is no list of {len(form) or 'any number of'} values")
        return [_understood(form[0] if form else 0.0, number, name) for number in numbers]
    if isinstance(form, float) and isinstance(content, int | float) and not isinstance(content, bool):
        try:
            number = float(content)
        except OverflowError:
            raise ValueError(f"{name} is too large") from None
        if not isfinite(number):
            raise ValueError(f"{name} is {content}")
        return number
    if type(content) is not type(form):
        raise ValueError(f"{name} is {content!r:.40}, and {type(form).__name__} is expected")
    return content


def _header(content: object) -> SimpleNamespace:
    """Frame and stamp, by the names of ROS 1 or ROS 2; those of a command are not used: clocks differ."""
    given = content if isinstance(content, dict) else {}
    stamp = given.get("stamp")
    times = stamp if isinstance(stamp, dict) else {}
    sec, nanosec = times.get("sec", times.get("secs", 0)), times.get("nanosec", times.get("nsecs", 0))
    whole = all(type(part) is int and abs(part) < 1 << 63 for part in (sec, nanosec))
    frame = given.get("frame_id")
    return SimpleNamespace(
        frame_id=frame if isinstance(frame, str) else "",
        stamp=SimpleNamespace(sec=sec, nanosec=nanosec) if whole else SimpleNamespace(sec=inf, nanosec=0),
    )


def _unset(form: Any) -> Any:  # noqa: ANN401 (any part of a form)
    return {} if isinstance(form, dict) else form
