"""What every localizer must do, as tests: see `artemis.testing.contracts`."""

from __future__ import annotations

from artemis.clock import stopwatch
from artemis.plugins.contracts import Localizer
from artemis.plugins.guard import LATE, plain_fixes
from artemis.plugins.registry import LOCALIZERS
from artemis.testing.contracts import PERIOD, PluginContract
from artemis.values import PoseFix


class LocalizerContract(PluginContract):
    """A localizer: inherit, set `plugin`, and `options` and `files` if it has any."""

    group = LOCALIZERS
    duration: float = 30.0
    """So long it is asked [s], of run time: nothing waits for it."""

    def found(self) -> list[tuple[float, PoseFix]]:
        """What a new one finds tick by tick, with the run times [s]; it is closed afterwards."""
        localizer: Localizer = self.make()
        found = []
        try:
            for tick in range(round(self.duration / PERIOD)):
                now, begun = tick * PERIOD, stopwatch()
                answer = localizer.fixes(now)
                took = stopwatch() - begun
                assert took <= 10 * LATE, f"fixes({now:.2f}) takes {took * 1000:.0f} ms, {LATE * 1000:.0f} are allowed"
                fixes = plain_fixes(answer)
                assert fixes is not None, f"fixes({now:.2f}) gave {answer!r}: not whole, or it cannot be true (PLG-06)"
                found += [(now, fix) for fix in fixes]
        finally:
            localizer.close()
            localizer.close()
        return found

    def test_fixes_are_whole_and_told_once(self) -> None:
        """Each answer is a tuple of fixes that can be true, and none comes again."""
        times = [fix.time for _, fix in self.found()]
        assert len(set(times)) == len(times), "a fix was told twice"

    def test_fixes_are_of_the_past(self) -> None:
        """And not so old that nobody knows where the odometry was then."""
        for now, fix in self.found():
            assert now - 2.0 <= fix.time <= now + PERIOD, (
                f"fixes({now:.2f}) gave one of {fix.time:.2f} s: it is not used"
            )
