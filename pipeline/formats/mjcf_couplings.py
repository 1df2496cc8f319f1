"""Derive the couplings of an MJCF's joints from MuJoCo's Jacobians: rows of its equalities, and moments of its actuators."""

from collections.abc import Collection
from typing import Any

import numpy as np

from pipeline.errors import InvalidInput
from pipeline.formats.mjcf_files import import_mujoco
from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.model import Mimic

ROUNDED = 1e-12  # of a coefficient that is 0


class Couplings:
    """Couplings and motors of a hand's joints, by their numbers: joints that follow another one, joints that are held, and motors."""

    def __init__(
        self,
        model: Any,  # compiled; its options are changed
        joints: Collection[int],  # of the hand
    ) -> None:
        mujoco = self._mujoco = import_mujoco()
        self._model, self._joints = model, set(joints)
        self.mimics: dict[int, Mimic] = {}
        self.held: dict[int, float] = {}  # rad (m)
        self.reach: dict[int, tuple[float, float]] = {}  # rad (m), between which a position actuator can hold its joint
        self.forces: list[float] = []  # N m (N), limits of actuators
        self.notes: list[str] = []  # what is ignored, or taken otherwise
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        data = mujoco.MjData(model)
        mujoco.mj_fwdPosition(model, data)
        moments = np.zeros((model.nu, model.nv))
        mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        actuators = [self._terms(row) for row in moments]
        self._driven = {joint for terms in actuators for joint in terms if len(terms) == 1}
        for number, residual, row in zip(data.efc_id[: data.ne], data.efc_pos, data.efc_J.reshape(-1, max(model.nv, 1)), strict=False):
            self._add_equality(model.equality(number), self._terms(row), float(residual))
        for number, terms in enumerate(actuators):
            self._add_actuator(model.actuator(number), terms)
        tendons = {*model.actuator_trnid[model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON), 0].tolist()}
        for ends in (model.eq_obj1id, model.eq_obj2id):
            tendons |= {*ends[model.eq_type == int(mujoco.mjtEq.mjEQ_TENDON)].tolist()}
        if loose := [model.tendon(tendon).name for tendon in range(model.ntendon) if tendon not in tendons]:
            self.notes.append(f"tendons that no actuator pulls and no equality ties are ignored: {', '.join(loose)}")
        if ignored := [model.equality(number).name for number in range(model.neq) if not model.eq_active0[number]]:
            self.notes.append(f"equalities that are not active are ignored: {', '.join(ignored)}")
        moved = {joint for terms in actuators for joint in terms} | {*self.held, *self.mimics}
        if idle := [model.joint(joint).name for joint in sorted(self._joints - moved)]:
            self.notes.append(f"no actuator of the MJCF moves {', '.join(idle)}; here each has a motor, unless it is frozen")

    def _terms(self, row: Array) -> dict[int, float]:  # (nv,) of a Jacobian
        """List the coefficients of the hand's joints."""
        terms = {int(self._model.dof_jntid[dof]): float(row[dof]) for dof in np.flatnonzero(np.abs(row) > ROUNDED)}
        return terms if self._joints & {*terms} else {}

    def _is_straight(self, kind: str, number: int) -> bool:
        """Check whether a joint, or a tendon, or none (-1) has a constant Jacobian: a spatial tendon has not."""
        wrap = self._model.wrap_type[self._model.tendon_adr[number]] if kind == "tendon" and number >= 0 else None
        return kind in ("joint", "tendon") and (wrap is None or wrap == int(self._mujoco.mjtWrap.mjWRAP_JOINT))

    def _add_equality(self, equality: Any, terms: dict[int, float], residual: float) -> None:
        """Let the sum of joints' travels from rest, each times its term, be minus the residual: one joint follows, or is held."""
        ends, names = (equality.obj1id.item(), equality.obj2id.item()), {joint: self._model.joint(joint).name for joint in terms}
        kind = self._mujoco.mjtEq(equality.type.item()).name.removeprefix("mjEQ_").lower()
        curved = equality.data[2:5].any() and ends[1] >= 0
        straight = all(self._is_straight(kind, end) for end in ends) and not curved
        followers = sorted({*terms} - {*self.mimics, *self.held}, key=lambda joint: (joint in self._driven, joint != ends[0], -joint))
        if terms and not (straight and len(terms) < 3 and followers):
            raise InvalidInput(
                f"{kind} {equality.name} ties joints {', '.join(names.values())}; links must be a tree, in which a joint follows one "
                'other along a line: delete it, or write <joint joint1="…" joint2="…" polycoef="… … 0 0 0"/>'
            )
        rest = {joint: self._model.joint(joint).qpos0.item() for joint in terms}
        for joint in followers[:1]:
            leader = next((other for other in terms if other != joint), None)
            value = rest[joint] - residual / terms[joint]
            if leader is None:
                self.held[joint] = value
            else:
                slope = -terms[leader] / terms[joint]
                self.mimics[joint] = Mimic(names[leader], slope, value - slope * rest[leader])

    def _add_actuator(self, actuator: Any, terms: dict[int, float]) -> None:
        """Read what an actuator does: joints that it pulls by a tendon move in proportion, unless they have a motor or a leader."""
        model, force = self._model, float(np.abs(actuator.forcerange).max()) if actuator.forcelimited else np.inf
        for joint, coefficient in terms.items():
            own = np.abs(model.jnt_actfrcrange[joint]).max() if model.jnt_actfrclimited[joint] else np.inf
            self.forces.append(float(min(abs(coefficient) * force, own)))
            if len(terms) == 1 and actuator.ctrllimited and actuator.biasprm[1] < 0:  # it moves to a position
                ends = (actuator.gainprm[0] * actuator.ctrlrange + actuator.biasprm[0]) / -actuator.biasprm[1] / coefficient
                self.reach[joint] = min(ends), max(ends)
        pulled = [joint for joint in terms if joint in self._joints - self._driven - {*self.mimics}]
        if actuator.trntype == int(self._mujoco.mjtTrn.mjTRN_TENDON) and self._is_straight("tendon", actuator.trnid[0]):
            for joint in pulled[1:]:
                leader, slope = model.joint(pulled[0]), terms[joint] / terms[pulled[0]]
                self.mimics[joint] = Mimic(leader.name, slope, model.joint(joint).qpos0.item() - slope * leader.qpos0.item())
                pair = f"{leader.name} and {model.joint(joint).name}"
                self.notes.append(f"one motor moves {pair} by a tendon: the second follows the first, by {slope:g}")
