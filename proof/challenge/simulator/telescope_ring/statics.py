"""Where the platform comes to rest: rigid closure with ideal joints, or least elastic energy with flexures.

`rigid_poses` solves |p + R b - a - (rho + offset) u| = length (eq. 5 of RR-8096) for spherical joints.
`elastic_poses` minimises the elastic energy of twelve circular flexures (eqs. 19-29, in co-rotating frames so
that motions may be large, with the shortening of a bent flexure) and of the ring, over the hub's pose, the
leg-end displacements and the poses of the six rigid leg bodies. At rho = 0 nothing is stressed. mm, N, rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .beams import Section
from .machine import FLEXURE_LENGTH, Machine
from .rotations import Array, exp_so3, hat, log_small

TITANIUM = 110_000.0  # Young's modulus, N/mm^2
STEP = 1e-30  # of the complex step; any tiny number gives derivatives exact to rounding


class NoEquilibriumError(RuntimeError):
    """The closure or the equilibrium did not converge."""


@dataclass(frozen=True)
class Flexure:
    """A circular flexure (figure 11 of RR-8096): length and diameter in mm, Young's modulus in N/mm^2."""

    length: float = FLEXURE_LENGTH
    diameter: float = 6.2
    young: float = TITANIUM

    @property
    def section(self) -> Section:
        """EA, EI, GJ of the bar."""
        return Section.round_bar(self.diameter, self.young)


@dataclass(frozen=True)
class Poses:
    """Solved configurations: hub (platform frame) in the base frame, and what bends."""

    rotation: Array  # (n, 3, 3)
    position: Array  # (n, 3), mm
    leg_end_displacement: Array  # (n, 6, 3), of b against the hub, platform frame, mm
    steps: int  # Newton steps taken


def rigid_poses(machine: Machine, travel: Array) -> Poses:
    """Platform poses with ideal spherical joints; travel (n, 6) in mm after any actuator scale."""
    gap = machine.lower_centres(np.zeros(6)) - machine.upper_centres
    height = float(np.sqrt(np.mean(machine.lengths**2 - np.sum(gap[:, :2] ** 2, axis=1))))
    return closed(machine.lower_centres(travel), machine.upper_centres, machine.lengths, height)


def closed(lower: Array, upper: Array, lengths: Array, height: float) -> Poses:
    """Poses at which legs of `lengths` ((n,) 6) join `lower` (n, 6, 3), base frame, and `upper` ((n,) 6, 3), platform.

    height: where the platform's origin is looked for first, mm above the base.
    """
    n = len(lower)
    R, p = np.tile(np.eye(3), (n, 1, 1)), np.tile([0.0, 0.0, height], (n, 1))
    seats = np.broadcast_to(upper, lower.shape)
    for step in range(30):
        arm = np.einsum("nij,nkj->nki", R, seats)
        leg = p[:, None] + arm - lower
        length = np.linalg.norm(leg, axis=-1)
        unit = leg / length[..., None]
        J = np.concatenate([unit, np.cross(arm, unit)], axis=-1)  # (n, 6, 6): d length by [v, w] in base
        move = np.linalg.solve(J, (lengths - length)[..., None])[..., 0]
        p, R = p + move[:, :3], exp_so3(move[:, 3:]) @ R
        if np.max(np.abs(move)) < 1e-11:
            return Poses(R, p, np.zeros((n, 6, 3)), step + 1)
    raise NoEquilibriumError("the rigid closure did not converge: is the travel within reach?")


@dataclass(frozen=True)
class _Home:
    """The unstressed assembly at rho = 0, from which the flexures bend."""

    hub_rotation: Array  # (3, 3)
    hub_position: Array  # (3,)
    leg_rotation: Array  # (6, 3, 3), x along the leg, base frame
    leg_middle: Array  # (6, 3), base frame
    half_body: Array  # (6,), half the rigid leg body between its flexures


def _home(machine: Machine, flexure: Flexure) -> _Home:
    rigid = rigid_poses(machine, np.zeros((1, 6)))
    R, p = rigid.rotation[0], rigid.position[0]
    c = machine.lower_centres(np.zeros(6))
    tip = p + machine.upper_centres @ R.T
    x = (tip - c) / np.linalg.norm(tip - c, axis=1)[:, None]
    y = np.cross(np.array([0.0, 0.0, 1.0]), x)
    y /= np.linalg.norm(y, axis=1)[:, None]
    legs = np.stack([x, y, np.cross(x, y)], axis=-1)
    return _Home(R, p, legs, (tip + c) / 2, (machine.lengths - flexure.length) / 2)


def flexure_measures(R1: Array, x1: Array, R2: Array, x2: Array, length: float) -> Array:
    """(..., 6) stretch, twist, bends and chord turns of a bar between end frames whose x axes lay along it.

    The order of `beams.natural_modes`, for motions of any size: seen from the mean of the end frames. The
    stretch is that of the arc: a bar bent by w with chord rotation beta spans l (1 - w^2/24 - beta^2/10).
    """
    turn = log_small(np.swapaxes(R1, -1, -2) @ R2)
    mean = R1 @ exp_so3(turn / 2)
    span = np.squeeze(np.swapaxes(mean, -1, -2) @ (x2 - x1)[..., None], -1)
    chord = np.sqrt(np.sum(span * span, axis=-1))
    slope = span[..., 1:] / span[..., :1]
    beta = np.arctan(np.stack([-slope[..., 1], slope[..., 0]], axis=-1))
    bend = turn[..., 1:]
    short = length * np.sum(bend * bend / 24 + beta * beta / 10, axis=-1)
    head = np.stack([chord - length + short, turn[..., 0]], axis=-1)
    return np.concatenate([head, bend, beta], axis=-1)


@dataclass(frozen=True)
class _State:
    """Unknowns of n poses: hub, leg-end displacements (u mm, phi rad; platform frame), leg bodies."""

    hub_rot: Array  # (n, 3, 3)
    hub_pos: Array  # (n, 3)
    q: Array  # (n, 6, 6)
    leg_rot: Array  # (n, 6, 3, 3)
    leg_pos: Array  # (n, 6, 3)

    def moved(self, h: Array) -> _State:
        """The state after steps h (..., 6 legs, 18): hub, leg end and leg body; the hub's as leg 1 says."""
        hub_rot, hub_pos = self.hub_rot @ exp_so3(h[..., 0, 3:6]), self.hub_pos + h[..., 0, :3]
        leg_rot = self.leg_rot @ exp_so3(h[..., 15:18])
        return _State(hub_rot, hub_pos, self.q + h[..., 6:12], leg_rot, self.leg_pos + h[..., 12:15])


@dataclass(frozen=True)
class _Chains:
    """The six chains actuator - flexure - leg body - flexure - ring, and their deformation measures."""

    machine: Machine
    flexure: Flexure
    nodes: Array  # (6, 3) of the ring's axis, platform frame
    home: _Home
    lower_ends: Array  # (n, 6, 3) fixed ends of the lower flexures on the actuators, base frame

    def measures(self, s: _State) -> Array:
        """(..., 6 legs, 12) measures of the lower and upper flexure of every leg."""
        home, length = self.home, self.flexure.length
        body = self.home.half_body[:, None] * s.leg_rot[..., :, 0]
        lower = flexure_measures(home.leg_rotation, self.lower_ends, s.leg_rot, s.leg_pos - body, length)
        seat_rot = home.hub_rotation.T @ home.leg_rotation  # (6, 3, 3) upper ends in the platform frame
        seat = self.machine.upper_centres + length / 2 * seat_rot[..., :, 0]
        turn = exp_so3(s.q[..., 3:])
        local = self.nodes + s.q[..., :3] + np.squeeze(turn @ (seat - self.nodes)[..., None], -1)
        hub_rot = s.hub_rot[..., None, :, :]
        end = s.hub_pos[..., None, :] + np.squeeze(hub_rot @ local[..., None], -1)
        upper = flexure_measures(s.leg_rot, s.leg_pos + body, hub_rot @ turn @ seat_rot, end, length)
        return np.concatenate([lower, upper], axis=-1)

    def derivative(self, s: _State) -> Array:
        """(18, n, 6 legs, 12) exact derivatives by each leg's 18 unknowns (complex step)."""
        n = len(s.hub_pos)
        h = np.zeros((18, n, 6, 18), dtype=complex)
        for k in range(18):
            h[k, :, :, k] = 1j * STEP
        return np.asarray(self.measures(s.moved(h)).imag / STEP)


def elastic_poses(
    machine: Machine, travel: Array, flexure: Flexure, nodes: Array, ring_compliance: Array | None
) -> Poses:
    """Equilibrium poses for travel (n, 6) in mm; `ring_compliance` (36, 36), None for a rigid ring.

    Newton steps on the energy 1/2 sum k m^2 + 1/2 q' C^-1 q. Second derivatives of the measures m are
    left out of the Hessian (they are small against it); the gradient vanishes at what is returned anyway.
    """
    n = len(travel)
    home = _home(machine, flexure)
    ends = machine.lower_centres(travel) - flexure.length / 2 * home.leg_rotation[..., :, 0]
    chains = _Chains(machine, flexure, nodes, home, ends)
    section = flexure.section
    modal = np.array([section.ea, section.gj, *[section.ei_y] * 2, *[12 * section.ei_y] * 2]) / flexure.length
    k = np.concatenate([modal, modal])
    ring = None if ring_compliance is None else np.linalg.inv(ring_compliance)
    s = _start(machine, travel, home)
    place = _places()
    for step in range(60):
        m, D = chains.measures(s), chains.derivative(s)
        gradient, hessian = np.zeros((n, 78)), np.zeros((n, 78, 78))
        for leg in range(6):
            Dl = np.moveaxis(D[:, :, leg], 0, 1)  # (n, 18, 12)
            gradient[:, place[leg]] += np.einsum("nij,j,nj->ni", Dl, k, m[:, leg])
            hessian[np.ix_(range(n), place[leg], place[leg])] += np.einsum("nij,j,nkj->nik", Dl, k, Dl)
        if ring is None:
            free = np.r_[0:6, 42:78]
        else:
            free = np.arange(78)
            gradient[:, 6:42] += s.q.reshape(n, 36) @ ring
            hessian[:, 6:42, 6:42] += ring
        move = np.zeros((n, 78))
        move[:, free] = -np.linalg.solve(hessian[:, free[:, None], free], gradient[:, free, None])[..., 0]
        s = s.moved(move[:, place])
        if np.max(np.abs(move)) < 1e-11:
            lever = machine.upper_centres - nodes
            tip = np.squeeze((exp_so3(s.q[..., 3:]) - np.eye(3)) @ lever[..., None], -1)
            return Poses(s.hub_rot, s.hub_pos, s.q[..., :3] + tip, step + 1)
    raise NoEquilibriumError("no equilibrium of the elastic platform was found: is the travel within reach?")


def _places() -> Array:
    """(6, 18) where each leg's unknowns stand among the 78: hub 0-5, leg ends 6-41, leg bodies 42-77."""
    own = 6 * np.arange(6)[:, None] + np.arange(6)
    return np.hstack([np.tile(np.arange(6), (6, 1)), 6 + own, 42 + own])


def _start(machine: Machine, travel: Array, home: _Home) -> _State:
    """Rigid poses with ideal joints, legs turned to point from centre to centre."""
    rigid = rigid_poses(machine, travel)
    n = len(travel)
    c = machine.lower_centres(travel)
    tip = rigid.position[:, None] + np.einsum("nij,kj->nki", rigid.rotation, machine.upper_centres)
    x0, x1 = home.leg_rotation[..., :, 0], (tip - c) / np.linalg.norm(tip - c, axis=-1)[..., None]
    swing = np.cross(np.broadcast_to(x0, x1.shape), x1)
    leg_rot = (np.eye(3) + hat(swing) + hat(swing) @ hat(swing) / 2) @ home.leg_rotation
    left, _, right = np.linalg.svd(leg_rot)
    return _State(rigid.rotation, rigid.position, np.zeros((n, 6, 6)), left @ right, (tip + c) / 2)
