"""Buses of udp_multicast: a port for each group, and a group that is free."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from artemis.devices.multicast import free_group, place_of, with_port


def test_groups_that_name_no_port_have_ports_of_their_own() -> None:
    """python-can binds the port of every group: with one port two simulations would share NMT and set-points."""
    words = [{"interface": "udp_multicast", "channel": f"239.74.163.{last}", "hop_limit": 0} for last in range(2, 12)]
    ports = [with_port(each).get("port", 43113) for each in words]
    assert len(set(ports)) == len(ports)
    assert ports[0] == 43113, "python-can's own group keeps its port, for other tools"
    assert with_port({**words[1], "port": 5000})["port"] == 5000
    assert with_port({"interface": "socketcan", "channel": "can0"}) == {"interface": "socketcan", "channel": "can0"}
    assert place_of(words[1]) == f"udp_multicast 239.74.163.3 port {ports[1]}"
    assert place_of(words[0]) == "udp_multicast 239.74.163.2"


@pytest.mark.skipif(sys.byteorder == "big", reason="the file is as of a little-endian computer")
def test_a_free_group_is_one_that_no_program_of_this_computer_listens_to(tmp_path: Path) -> None:
    joined = tmp_path / "igmp"
    assert free_group(joined) == "239.74.163.3"
    joined.write_text(
        "Idx\tDevice    : Count Querier\tGroup    Users Timer\tReporter\n"
        "1\tlo        :     2      V3\n\t\t\t\t03A34AEF     1 0:00000000\t\t0\n\t\t\t\t04A34AEF     1 0:00000000\t\t0\n"
    )
    assert free_group(joined) == "239.74.163.5"
