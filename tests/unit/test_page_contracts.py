"""The page's input and its observer keep the contracts of all plugins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

pytest.importorskip("starlette", reason="needs the extra web: pip install 'artemis-robot[web]'")
pytest.importorskip("uvicorn", reason="needs the extra web: pip install 'artemis-robot[web]'")
pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
pytest.importorskip("segno", reason="needs the extra web: pip install 'artemis-robot[web]'")

from test_page_input import Port

from artemis.bridges.operator.session import Arrived, LinkReport
from artemis.page.observer import PageObserver
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.page import PageInput, PageInputConfig
from artemis.testing.contracts import InputContract
from artemis.testing.observers import ObserverContract
from artemis.values import OperatorInput
from artemis_lab.bench.ports import free_port


class HeldPage(PageInput):
    """On virtual time, with somebody at the page who is there at once."""

    def __init__(self, config: PageInputConfig, context: PluginContext) -> None:
        self.now, self.reports = 0.0, Port()
        super().__init__(config, context, self.reports, lambda: self.now)
        self.held, self.stick = False, (0.0, 0.0)

    def read(self, now: float) -> OperatorInput:
        self.now = now
        arrived = Arrived(now, True, self.held, not self.held, 0.0, 0.0, 0.0, self.stick)
        self.reports.reports.append(LinkReport("held", "phone", 0.0, newest=arrived))
        return super().read(now)


class TestPageInput(InputContract):
    plugin = PageInput
    options: Mapping[str, object] = {"max_speed_m_s": 0.5}
    duration = 20.0

    def make(self) -> HeldPage:
        return HeldPage(PageInputConfig.model_validate(dict(self.options)), self.given())

    def move(self, device: Any) -> None:  # noqa: ANN401
        device.held, device.stick = True, (0.5, 0.5)


class TestPageObserver(ObserverContract):
    plugin = PageObserver
    options: Mapping[str, object] = {"port": free_port()}
