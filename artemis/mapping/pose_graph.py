"""A graph of poses and measured motions between them, and its robust least squares solution.

Levenberg-Marquardt on sparse normal equations: G. Grisetti et al., A tutorial on graph-based SLAM, IEEE Intelligent
Transportation Systems Magazine 2(4), 2010. Cauchy's loss: a motion off by d standard deviations weighs 1/(1 + d²/s²).

Where only the odometry measures how far the robot drove, its errors are not independent from link to link: a wrong
wheel size acts all along. The share by which the odometry is wrong is an unknown of the graph, which changes slowly.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from artemis.mapping.se2 import Array, between
from artemis.motion.arrays import wrapped

LOOP_LENGTH = 0.5
"""A loop counts as so many metres where drift is guessed by the distance [m]."""
_LEAST_CHANGE = 1e-4
"""Of the cost, as a share: less is no progress."""
_UNTOLD = np.diag([1.0, 1.0, 10.0])
"""Information that is added to a match: the covariance of what no beam constrains stays finite."""
_FLOOR = np.diag([1e-4, 1e-4, 9e-6])
"""Covariance that is added to a match [m², m², rad²]: errors of 1 cm and 0.17 degrees that all beams have in common."""
_STRETCH = 40
"""Key scans over which the odometry is wrong by one share."""
_SHARE, _SHARE_CHANGE = 0.05, 0.01
"""Standard deviations of the first share, and of the change from one stretch to the next."""
_ALL_TOLD = np.zeros(2)


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A measured motion between two poses."""

    first: int
    second: int
    motion: Array
    """From the first pose to the second, seen from the first, shape (3,)."""
    information: Array
    """Inverse covariance of x, y, heading of the motion, shape (3, 3)."""
    loop: bool
    """Between two visits of a place; else from one key scan to the next."""
    untold: Array = field(default_factory=lambda: _ALL_TOLD)
    """Part of the motion that only the odometry measured: x, y [m] seen from the first pose, shape (2,)."""


def match_information(information: Array, heading: float, beam: float) -> Array:
    """Information of a motion from that of a match.

    Args:
        information: of the match, in the frame of the map, for beams with a standard deviation of 1 m.
        heading: of the pose from which the motion is seen, in the frame of the map [rad].
        beam: standard deviation of a beam [m].
    """
    c, s = np.cos(heading), np.sin(heading)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    covariance = np.linalg.inv(turned.T @ information @ turned / beam**2 + _UNTOLD) + _FLOOR
    return np.asarray(np.linalg.inv(covariance))


class PoseGraph:
    """Links by their numbers. Any can be removed: the graph is as if it had never been added."""

    def __init__(self) -> None:
        self.links: dict[int, Link] = {}
        self._next = 0
        self._ends, self._lengths = array("q"), array("d")

    def add(self, link: Link) -> int:
        """Add a link; its number."""
        self._next += 1
        self.links[self._next] = link
        self._note(link)
        return self._next

    def restore(self, number: int, link: Link) -> None:
        """Add a link under the number that it had."""
        self._next = max(self._next, number)
        self.links[number] = link
        self._note(link)

    def remove(self, number: int) -> None:
        """Take a link out again."""
        del self.links[number]
        self._ends, self._lengths = array("q"), array("d")
        for link in self.links.values():
            self._note(link)

    def _note(self, link: Link) -> None:
        x, y, turn = link.motion
        self._ends.extend((link.first, link.second))
        self._lengths.append(LOOP_LENGTH if link.loop else math.hypot(x, y) + 0.3 * abs(turn) + 0.02)

    @property
    def loops(self) -> dict[int, Link]:
        """Those between two visits of a place."""
        return {number: link for number, link in self.links.items() if link.loop}

    def deviations(self, poses: Array) -> dict[int, float]:
        """By how many standard deviations each link is off at these poses, shape (n, 3)."""
        if not self.links:
            return {}
        system = _System(self.links.values(), 1.0, 1.0)
        return dict(zip(self.links, np.sqrt(system.errors(poses, system.shares(poses))[1]).tolist(), strict=True))

    def solve(self, poses: Array, rounds: int, cauchy_loop: float, cauchy_step: float) -> Array:
        """The poses that fit the links best; the first stays where it is.

        Args:
            poses: to begin with, shape (n, 3).
            rounds: at most.
            cauchy_loop: scale of the loss of a loop, in standard deviations.
            cauchy_step: likewise of the other links.
        """
        if len(poses) < 2 or not self.links:
            return poses
        system, damping = _System(self.links.values(), cauchy_loop, cauchy_step), 0.0
        shares = system.shares(poses)
        errors, weights, cost = system.weighted(poses, shares)
        for _ in range(rounds):
            moved = poses.copy()
            too_far, too_much = system.step(poses, shares, errors, weights, damping)
            moved[1:] -= too_far
            moved[:, 2] = wrapped(moved[:, 2])
            new_shares = shares - too_much
            new_errors, new_weights, new_cost = system.weighted(moved, new_shares)
            if new_cost > cost * (1 + _LEAST_CHANGE):
                damping = max(1e-4, 10 * damping)
                continue
            done = cost - new_cost < _LEAST_CHANGE * cost
            poses, shares, errors, weights, cost = moved, new_shares, new_errors, new_weights, new_cost
            damping = damping / 10 if damping > 1e-6 else 0.0
            if done:
                break
        return poses

    def distances_from(self, key: int, count: int) -> tuple[Array, NDArray[np.int64]]:
        """The shortest path through the graph from each of `count` poses to pose `key`.

        Returns:
            Its length [m], infinite where there is none; and the pose that comes next on it, negative where there is
            none; shape (count,) each.
        """
        ends, lengths = np.array(self._ends).reshape(-1, 2), np.array(self._lengths)
        first, second = np.concatenate([ends, ends[:, ::-1]]).T  # a graph with both directions saves SciPy much work
        order = np.argsort(first, kind="stable")
        begins = np.append(0, np.cumsum(np.bincount(first, minlength=count)))
        graph = sparse.csr_matrix((np.tile(lengths, 2)[order], second[order], begins), shape=(count, count))
        found, following = dijkstra(graph, indices=key, return_predecessors=True)
        return np.asarray(found), np.asarray(following, np.int64)


class _System:
    """The equations of a graph as arrays."""

    def __init__(self, links: Iterable[Link], cauchy_loop: float, cauchy_step: float) -> None:
        rows = list(links)
        self.first = np.array([link.first for link in rows])
        self.second = np.array([link.second for link in rows])
        self.motion = np.array([link.motion for link in rows])
        self.information = np.array([link.information for link in rows])
        self.scale = np.where([link.loop for link in rows], cauchy_loop, cauchy_step) ** 2
        self.untold = np.array([[*link.untold, 0.0] for link in rows])
        self.stretch = self.first // _STRETCH
        count = int(self.stretch.max()) + 1
        changes = sparse.eye(count, format="csr") - sparse.eye(count, k=-1, format="csr")
        sure = np.full(count, _SHARE_CHANGE**-2)
        sure[0] = _SHARE**-2
        self.slow = sparse.csr_matrix(changes.T @ sparse.diags(sure) @ changes)
        """Information of the shares that is known beforehand."""

    def shares(self, poses: Array) -> Array:
        """Of each stretch: by which share the odometry is wrong, estimated from these poses."""
        count = self.slow.shape[0]
        off, _ = self.errors(poses, np.zeros(count))
        told = np.einsum("ma,mab->mb", self.untold, self.information)
        information = np.bincount(self.stretch, (told * self.untold).sum(1), count)
        right = np.bincount(self.stretch, (told * off).sum(1), count)
        return np.asarray(splu((self.slow + sparse.diags(information)).tocsc()).solve(right))

    def errors(self, poses: Array, shares: Array) -> tuple[Array, Array]:
        """What these poses have more than was measured, shape (m, 3), and its square in standard deviations, (m,)."""
        off = between(poses[self.first], poses[self.second]) - self.motion - shares[self.stretch, None] * self.untold
        off[:, 2] = wrapped(off[:, 2])
        return off, np.einsum("ma,mab,mb->m", off, self.information, off)

    def weighted(self, poses: Array, shares: Array) -> tuple[Array, Array, float]:
        """Errors, Cauchy weights, and the cost of it all."""
        off, square = self.errors(poses, shares)
        cost = float((self.scale * np.log1p(square / self.scale)).sum() + shares @ (self.slow @ shares))
        return off, 1 / (1 + square / self.scale), cost

    def step(self, poses: Array, shares: Array, off: Array, weights: Array, damping: float) -> tuple[Array, Array]:
        """By how much the poses but the first are too far, shape (n - 1, 3), and the shares too large."""
        n, m, count = len(poses), len(self.first), len(shares)
        c, s = np.cos(poses[self.first, 2]), np.sin(poses[self.first, 2])
        dx, dy = (poses[self.second, :2] - poses[self.first, :2]).T
        zero, one = np.zeros(m), np.ones(m)
        by_first = np.array([[-c, -s, c * dy - s * dx], [s, -c, -c * dx - s * dy], [zero, zero, -one]])
        by_second = np.array([[c, s, zero], [-s, c, zero], [zero, zero, one]])
        by_all = np.concatenate(
            [by_first.transpose(2, 0, 1), by_second.transpose(2, 0, 1), -self.untold[:, :, None]], 2
        )
        inner = np.arange(3)
        of_poses = np.c_[3 * self.first[:, None] + inner, 3 * self.second[:, None] + inner]
        column = np.repeat(np.c_[of_poses, 3 * n + self.stretch], 3, axis=0)
        begins = np.arange(0, column.size + 1, column.shape[1])
        jacobian = sparse.csr_matrix((by_all.reshape(-1), column.reshape(-1), begins), shape=(3 * m, 3 * n + count))
        jacobian.eliminate_zeros()
        jacobian = jacobian[:, 3:]
        information = sparse.bsr_matrix(
            (self.information * weights[:, None, None], np.arange(m), np.arange(m + 1)), shape=(3 * m, 3 * m)
        )
        weighted = jacobian.T @ information
        before = sparse.block_diag([sparse.csr_matrix((3 * n - 3, 3 * n - 3)), self.slow])
        normal = (weighted @ jacobian + before).tocsc()
        right = weighted @ off.reshape(-1) + before @ np.r_[np.zeros(3 * n - 3), shares]
        damped = (normal + sparse.diags(damping * normal.diagonal())).tocsc() if damping else normal
        factors = splu(damped, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        found = np.asarray(factors.solve(right))
        return found[: 3 * n - 3].reshape(-1, 3), found[3 * n - 3 :]
