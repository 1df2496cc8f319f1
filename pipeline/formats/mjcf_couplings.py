"""The couplings of an MJCF's joints: equalities of joints and of fixed tendons, and motors that pull several joints by one tendon."""

from collections.abc import Collection, Mapping
from typing import Any

from pipeline.errors import InvalidInput
from pipeline.kernels.hand.model import Mimic

Terms = dict[int, float]
"""A sum over joints: the coefficient of each joint's travel from rest, by its number."""


class Couplings:
    """What ties the joints of a hand: joints that follow another, joints that are held, and what is ignored, as sentences."""

    def __init__(
        self,
        mujoco: Any,
        model: Any,  # compiled
        names: Mapping[int, str],  # of all joints
        joints: Collection[int],  # of the hand
        bodies: Collection[int],  # of the hand
    ) -> None:
        self._mujoco, self._model, self._names, self._joints, self._bodies = mujoco, model, names, frozenset(joints), frozenset(bodies)
        self.mimics: dict[str, Mimic] = {}
        self.held: Terms = {}  # values of joints, rad (m)
        self.notes: list[str] = []
        self._forces: Terms = {}  # of joints that are moved by actuators, N m (N); infinite without a limit
        self._driven: set[int] = set()  # joints with actuators of their own
        self._tendons = {tendon: self._tendon_terms(tendon) for tendon in range(model.ntendon)}
        self._unused = set(self._tendons)
        pulled = self._read_actuators()
        for number in range(model.neq):
            self._read_equality(number)
        for tendon in pulled:
            self._read_pulled(tendon)
        if self._unused:
            self.notes.append(f"ignored tendons: {', '.join(self._name('tendon', tendon) for tendon in sorted(self._unused))}")
        moved = {*self._forces, *self.held, *(joint for joint in self._joints if names[joint] in self.mimics)}
        if idle := [names[joint] for joint in sorted(self._joints - moved)]:
            self.notes.append(f"no actuator of the MJCF moves {', '.join(idle)}; here each has a motor, unless it is frozen")

    @property
    def least_force(self) -> float | None:
        """The least limit of the hand's motors, N m (N); None if they have none."""
        forces = [force for joint, force in self._forces.items() if joint in self._joints and force < float("inf")]
        return min(forces, default=None)

    def _name(self, kind: str, number: int) -> str:
        return getattr(self._model, kind)(number).name or f"{kind} {number}"

    def _tendon_terms(self, tendon: int) -> Terms:
        """List the joints of a fixed tendon; a spatial one has none."""
        model, first = self._model, int(self._model.tendon_adr[tendon])
        wraps = range(first, first + int(model.tendon_num[tendon]))
        fixed = [wrap for wrap in wraps if model.wrap_type[wrap] == int(self._mujoco.mjtWrap.mjWRAP_JOINT)]
        return {int(model.wrap_objid[wrap]): float(model.wrap_prm[wrap]) for wrap in fixed}

    def _read_actuators(self) -> list[int]:
        """Read which joints have motors, and their limits; return the tendons that actuators pull."""
        model, types, pulled = self._model, self._mujoco.mjtTrn, list[int]()
        for actuator in range(model.nu):
            target, terms, kind = int(model.actuator_trnid[actuator, 0]), Terms(), types(int(model.actuator_trntype[actuator]))
            if kind in (types.mjTRN_JOINT, types.mjTRN_JOINTINPARENT):
                terms = {target: 1.0}
                self._driven.add(target)
            elif kind == types.mjTRN_TENDON:
                terms = self._tendons[target]
                pulled.append(target)
            for joint, coefficient in terms.items():
                force = abs(coefficient * float(model.actuator_gear[actuator, 0])) * self._actuator_force(actuator)
                self._forces[joint] = min(force, self._forces.get(joint, float("inf")))
        for joint in self._forces:
            if model.jnt_actfrclimited[joint]:
                self._forces[joint] = min(self._forces[joint], float(abs(model.jnt_actfrcrange[joint]).max()))
        return pulled

    def _actuator_force(self, actuator: int) -> float:
        """Find the limit of an actuator's force: its own, or of a plain motor the largest control."""
        model = self._model
        if model.actuator_forcelimited[actuator]:
            return float(abs(model.actuator_forcerange[actuator]).max())
        plain = model.actuator_biastype[actuator] == int(self._mujoco.mjtBias.mjBIAS_NONE) and model.actuator_ctrllimited[actuator]
        return float(abs(model.actuator_gainprm[actuator, 0] * model.actuator_ctrlrange[actuator]).max()) if plain else float("inf")

    def _read_equality(self, number: int) -> None:
        model, types = self._model, self._mujoco.mjtEq
        kind, name = types(int(model.eq_type[number])), self._name("equality", number)
        ends = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if not model.eq_active0[number]:
            self.notes.append(f"equality {name} is not active: ignored")
        elif kind in (types.mjEQ_JOINT, types.mjEQ_TENDON):
            one, other = ({end: 1.0} if kind == types.mjEQ_JOINT else self._tendons[end] if end >= 0 else Terms() for end in ends)
            self._unused -= set(ends) if kind == types.mjEQ_TENDON else set()
            constant, slope, *curve = model.eq_data[number, :5].tolist()
            if ends[1] < 0:
                other, slope, curve = Terms(), 0.0, []
            if not (self._joints & {*one, *other}):
                return
            if any(curve):
                coefficients = " ".join(f"{value:g}" for value in (constant, slope, *curve))
                raise InvalidInput(f"equality {name} is a curve, polycoef {coefficients}; only lines are read: make the last three 0")
            if not one or (slope and not other):
                raise InvalidInput(f"equality {name} ties a spatial tendon; tie joints, or tendons of the kind <fixed>")
            terms = dict(one)
            for joint, coefficient in other.items():
                terms[joint] = terms.get(joint, 0.0) - slope * coefficient
            followers = list(one) if kind == types.mjEQ_JOINT else []
            self._tie(f"equality {name}", terms, constant, followers)
        else:
            on_sites = model.eq_objtype[number] == int(self._mujoco.mjtObj.mjOBJ_SITE)
            bodies = [int(model.site_bodyid[end]) if on_sites else end for end in ends]
            if self._bodies >= set(bodies):
                first, second = (self._name("body", body) for body in bodies)
                raise InvalidInput(
                    f"equality {name} ties bodies {first} and {second}, which closes a loop, and links must be a tree; in its place, let "
                    "joints follow another one: <joint joint1=… joint2=… polycoef=…/>"
                )
            if self._bodies & set(bodies):
                self.notes.append(f"equality {name} ties the hand to something else: ignored")

    def _read_pulled(self, tendon: int) -> None:
        """Let the joints that one motor pulls by a tendon move in proportion, those with motors of their own aside."""
        terms = {joint: coefficient for joint, coefficient in self._tendons[tendon].items() if coefficient and joint not in self._driven}
        free = [joint for joint in terms if joint in self._joints and self._names[joint] not in self.mimics]
        for joint in free[1:]:
            self._tie("", {joint: 1.0, free[0]: -terms[joint] / terms[free[0]]}, 0.0, [joint])
            what = f"tendon {self._name('tendon', tendon)} moves {self._names[free[0]]} and {self._names[joint]} by one motor"
            self.notes.append(f"{what}, so that one follows the other, by {terms[joint] / terms[free[0]]:g}")
        self._unused -= {tendon} if terms else set()

    def _tie(self, what: str, terms: Terms, constant: float, followers: list[int]) -> None:
        """Let the sum `terms` be constant: of two joints one follows the other, `followers` first, and rather one without a motor."""
        model = self._model
        terms = {joint: coefficient for joint, coefficient in terms.items() if coefficient}
        rest = {joint: float(model.qpos0[model.jnt_qposadr[joint]]) for joint in terms}
        if len(terms) == 1:
            ((joint, coefficient),) = terms.items()
            self.held[joint] = rest[joint] + constant / coefficient
            return
        if len(terms) != 2:
            listed = ", ".join(self._names[joint] for joint in terms) or "none"
            raise InvalidInput(f"{what} ties {len(terms)} joints ({listed}); a joint can follow one other")
        order = sorted(terms, key=lambda joint: (joint in self._driven, joint not in followers, -joint))
        follower = next((joint for joint in order if self._names[joint] not in self.mimics), None)
        if follower is None:
            first, second = (self._names[joint] for joint in terms)
            raise InvalidInput(f"{what} ties joints {first} and {second}, each of which follows another one already; delete a tie")
        (leader,) = set(terms) - {follower}
        slope = -terms[leader] / terms[follower]
        offset = rest[follower] + constant / terms[follower] - slope * rest[leader]
        self.mimics[self._names[follower]] = Mimic(self._names[leader], slope, offset)
