"""The limits that are watched after every step follow what they are made of: objects, homing, restarts."""

from __future__ import annotations

from sim_epos_rig import STEERING, Rig

from artemis.sim.axis import Failure

POSITION_LIMIT, FOLLOWING_ERROR = 0xFF09, 0x8611


def moving(rig: Rig, rpm: int) -> Rig:
    """In the velocity mode, which has no following error."""
    rig.enable(-2)
    rig.write(0x206B, 0, "i", rpm)
    return rig


def test_position_limits_count_from_where_homing_put_zero() -> None:
    rig = Rig(STEERING)
    rig.write(0x607D, 1, "i", 50000)
    rig.write(0x607D, 2, "i", 51000)
    rig.write(0x6098, 0, "b", 35)
    rig.write(0x2081, 0, "i", 50500)
    rig.enable(6)
    rig.run(0.01)
    assert rig.emergencies() == [], "the homing mode does not mind the limits"
    rig.control(0x001F)
    rig.write(0x6060, 0, "b", -2)
    rig.run(0.01)
    assert rig.emergencies() == []
    rig.write(0x206B, 0, "i", 600)
    while rig.axis.position < 500.0:
        assert rig.emergencies() == []
        rig.run(0.001)
    rig.run(0.001)
    assert rig.emergencies() == [POSITION_LIMIT]


def test_position_limits_act_as_they_are_written() -> None:
    rig = moving(Rig(STEERING), 600)
    rig.write(0x607D, 2, "i", 1000)
    rig.write(0x607D, 2, "i", 2**31 - 1)
    rig.run(0.2)
    assert rig.emergencies() == []
    rig.write(0x607D, 2, "i", 1000)
    rig.run(0.001)
    assert rig.emergencies() == [POSITION_LIMIT]


def test_position_limits_that_were_not_stored_are_gone_after_a_restart() -> None:
    rig = Rig(STEERING)
    rig.write(0x607D, 2, "i", 1000)
    rig.nmt(0x81)
    rig.run(0.06)
    moving(rig, 3000)
    rig.run(0.2)
    assert rig.axis.position > 1000.0
    assert rig.emergencies() == []


def test_the_following_limit_acts_as_it_is_written() -> None:
    rig = Rig(STEERING)
    rig.enable(-1)
    rig.axis.failure = Failure(blocked=True)
    rig.write(0x2062, 0, "i", 1500)
    rig.run(0.01)
    assert rig.emergencies() == []
    rig.write(0x6065, 0, "I", 1000)
    rig.run(0.001)
    assert rig.emergencies() == [FOLLOWING_ERROR]


def test_no_power_and_no_boot_means_no_watching() -> None:
    rig = Rig(STEERING)
    rig.node.power_off()
    rig.axis.supply_voltage = 5.0
    rig.run(0.01)
    assert rig.emergencies() == []
    rig.node.power_on(rig.now)
    rig.run(0.04)
    assert rig.emergencies() == []
    rig.run(0.03)
    assert rig.emergencies() == [0x3220]
