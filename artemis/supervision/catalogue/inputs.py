"""Faults of what a person drives with: devices on this computer and on the network."""

from __future__ import annotations

from artemis.supervision.catalogue.row import ITSELF, MINUTE, S1, S2, WARN, Found, K, Row, Threshold, automatic

_TEN = 10 * MINUTE
_SEEN, _ABSENT, _DESIGN = Found.MEASURED, Found.ABSENT, Found.DESIGN
_NETWORK = "needs an input over the network"

INPUTS: dict[str, Row] = {
    "INP-01": Row("input lost", Found.MODE, S2, automatic(3, _TEN), "input lost", "is it plugged in?", within=0.06),
    "INP-02": Row(
        "another device",
        _DESIGN,
        reason="a device that comes, be it again, drives only after half a second of rest and a new press of enable",
    ),
    "INP-03": Row(
        "input frozen",
        Found.MODE,
        S2,
        automatic(3, _TEN),
        "input frozen: nothing new from it",
        "cable, radio, battery of the device",
        within=0.17,
    ),
    "INP-04": Row(
        "silent device held",
        Found.ELSEWHERE,
        S2,
        automatic(3, _TEN),
        within=0.17,
        shows_as=("INP-03",),
        reason="its age grows; where silence is normal, 2 s of it in motion limit the speed to 0.3 m/s, and 4 s count "
        "as a release",
    ),
    "INP-05": Row(
        "repeated reports",
        Found.ELSEWHERE,
        S2,
        automatic(3, _TEN),
        within=0.17,
        shows_as=("INP-03",),
        reason="a repeated report is not a new sample: its age grows",
    ),
    "INP-06": Row(
        "values out of range",
        Found.EDGE,
        S2,
        automatic(3, _TEN),
        "sent values out of range",
        "calibrate the device; see its raw values",
        within=1.02,
    ),
    "INP-07": Row(
        "not centred at arm",
        _DESIGN,
        reason="arming waits until every axis rests and the enable button is released",
    ),
    "INP-08": Row(
        "axis jumps",
        _SEEN,
        WARN,
        ITSELF,
        "jumps faster than a hand can move it",
        "loose contact?",
        within=0.52,
        of="jumps of more than 60 % of the range in 0.5 s",
        stages=(Threshold(WARN, 1.0),),
    ),
    "INP-09": Row(
        "enable button released",
        _DESIGN,
        recovery=ITSELF,
        reason="not a fault: the gate ramps to standstill; driving continues when it is pressed again at standstill",
    ),
    "INP-10": Row("enable button tied down", _DESIGN, reason="arming waits until it is released"),
    "INP-11": Row(
        "stop button",
        _DESIGN,
        reason="not a fault: every input may ask for the quick stop in every mode",
    ),
    "INP-12": Row(
        "two inputs at once",
        _DESIGN,
        reason="only the inputs of the present step drive, of several the first that is active; every input may stop",
    ),
    "INP-13": Row(
        "hand-over in motion",
        _DESIGN,
        reason="a step begins at standstill; in it an input of higher priority takes over at once, within the limits, "
        "and one of lower priority at standstill, once its controls were neutral",
    ),
    "INP-14": Row("accelerator and brake", _DESIGN, reason="the brake wins"),
    "INP-15": Row(
        "pedal stuck",
        _DESIGN,
        reason="arming waits until it is released; 60 s without any movement while driving count as a release",
    ),
    "INP-16": Row(
        "force feedback fails",
        Found.EDGE,
        WARN,
        ITSELF,
        "cannot show what the robot does",
        "see the reason; `rumble: false` and `wheel_force: 0` leave it out",
    ),
    "NET-01": Row("link lost", _ABSENT, S2, automatic(5, _TEN), reason=_NETWORK),
    "NET-02": Row("latency", _ABSENT, S2, automatic(5, _TEN), reason=_NETWORK),
    "NET-03": Row("jitter", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-04": Row("stall, then a burst", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-05": Row("loss", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-06": Row("replayed packets", _ABSENT, S2, K, reason=_NETWORK),
    "NET-07": Row("not authenticated", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-08": Row("not authorised", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-09": Row("malformed packets", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-10": Row("flood", _ABSENT, WARN, ITSELF, reason=_NETWORK),
    "NET-11": Row("stop on a stale page", _ABSENT, S1, K, reason=_NETWORK),
    "NET-12": Row("dashboard dies", _ABSENT, WARN, ITSELF, reason=_NETWORK),
}
