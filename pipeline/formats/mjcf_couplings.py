"""The couplings of an MJCF's joints: equalities of joints and of fixed tendons, and motors that pull several joints by one tendon."""

from collections.abc import Sequence
from typing import Any

from pipeline.errors import InvalidInput
from pipeline.formats.mjcf_files import kind_of
from pipeline.kernels.hand.model import Mimic

Terms = dict[int, float]
"""A sum over joints: the coefficient of each joint's travel from rest, by its number."""
UNLIMITED = float("inf")


class Couplings:
    """What ties the joints of a hand, by their numbers: joints that follow another one, and joints that are held at a value."""

    def __init__(
        self,
        model: Any,  # compiled
        bodies: frozenset[int],  # of the hand, its root the first
    ) -> None:
        self._model, self._bodies = model, bodies
        self._joints = {joint for joint in range(model.njnt) if model.jnt_bodyid[joint] in bodies - {min(bodies)}}
        self.mimics: dict[int, Mimic] = {}
        self.held: Terms = {}
        self.notes: list[str] = []  # what is ignored, or taken otherwise
        self._forces: Terms = {}  # of joints that actuators move, N m (N)
        self._driven: set[int] = set()  # joints with actuators of their own
        self.reach: dict[int, tuple[float, float]] = {}  # values between which such an actuator can hold its joint, rad (m)
        self._tendons = [self._tendon_terms(tendon) for tendon in range(model.ntendon)]
        pulled = [tendon for actuator in range(model.nu) for tendon in self._add_actuator(model.actuator(actuator))]
        tied = [tendon for number in range(model.neq) for tendon in self._add_equality(model.equality(number))]
        for tendon in pulled:
            self._add_pulled(tendon)
        if loose := [model.tendon(tendon).name for tendon in range(model.ntendon) if tendon not in tied and tendon not in pulled]:
            self.notes.append(f"tendons that couple nothing are ignored: {', '.join(loose)}")
        if idle := sorted(self._joints - {*self._forces, *self.held, *self.mimics}):
            names = ", ".join(model.joint(joint).name for joint in idle)
            self.notes.append(f"no actuator of the MJCF moves {names}; here each has a motor, unless it is frozen")

    @property
    def least_force(self) -> float | None:
        """The least limit of the hand's motors, N m (N); None if they have none."""
        return min((self._forces[joint] for joint in self._joints & {*self._forces} if self._forces[joint] < UNLIMITED), default=None)

    def _tendon_terms(self, tendon: int) -> Terms:
        """List the joints of a fixed tendon; a spatial one has none."""
        model = self._model
        wraps = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        fixed = [wrap for wrap in wraps if kind_of("mjtWrap", model.wrap_type[wrap]) == "joint"]
        return {int(model.wrap_objid[wrap]): float(model.wrap_prm[wrap]) for wrap in fixed}

    def _add_actuator(self, actuator: Any) -> list[int]:
        """Note which joints an actuator moves, and its limit: its own, or of a motor its largest control; return the tendon it pulls."""
        kind, target, force = kind_of("mjtTrn", actuator.trntype), int(actuator.trnid[0]), UNLIMITED
        if actuator.forcelimited:
            force = abs(actuator.forcerange).max()
        elif actuator.ctrllimited and kind_of("mjtBias", actuator.biastype) == "none":
            force = abs(actuator.gainprm[0] * actuator.ctrlrange).max()
        if kind == "joint" and actuator.ctrllimited and actuator.biasprm[1] < 0 and actuator.gear[0]:  # to a position
            ends = (actuator.gainprm[0] * actuator.ctrlrange + actuator.biasprm[0]) / -actuator.biasprm[1] / actuator.gear[0]
            self.reach[target] = min(ends), max(ends)
        terms = {target: 1.0} if kind in ("joint", "jointinparent") else self._tendons[target] if kind == "tendon" else {}
        self._driven |= set(terms) if kind != "tendon" else set()
        for joint, coefficient in terms.items():
            own = abs(self._model.jnt_actfrcrange[joint]).max() if self._model.jnt_actfrclimited[joint] else UNLIMITED
            limits = (self._forces.get(joint, UNLIMITED), own, abs(coefficient * actuator.gear[0]) * force)
            self._forces[joint] = float(min(limits))
        return [target] if kind == "tendon" and terms else []

    def _add_equality(self, equality: Any) -> list[int]:
        """Read an equality; return the tendons that it ties."""
        kind, ends = kind_of("mjtEq", equality.type), [equality.obj1id.item(), equality.obj2id.item()]
        if not equality.active0:
            self.notes.append(f"{equality.name} is not active: ignored")
        elif kind in ("joint", "tendon"):
            one, other = ({} if end < 0 else {end: 1.0} if kind == "joint" else self._tendons[end] for end in ends)
            constant, slope, *curve = equality.data[:5].tolist()
            if not self._joints & {*one, *other}:
                return []
            if not one or (ends[1] >= 0 and not other):
                raise InvalidInput(f"{equality.name} ties a spatial tendon; tie joints, or tendons of the kind <fixed>")
            if other and any(curve):
                line = f'polycoef="{constant:g} {slope:g} 0 0 0"'
                raise InvalidInput(f"{equality.name} ties joints by a curve; only lines are read: write {line}")
            terms = {joint: one.get(joint, 0.0) - slope * other.get(joint, 0.0) for joint in {**one, **other}}
            self._tie(equality.name, terms, constant, [*one] if kind == "joint" else [])
            return ends if kind == "tendon" else []
        else:
            self._refuse_loop(equality, ends)
        return []

    def _refuse_loop(self, equality: Any, ends: Sequence[int]) -> None:
        on_sites = kind_of("mjtObj", self._model.eq_objtype[equality.id]) == "site"
        bodies = {int(self._model.site_bodyid[end]) if on_sites else end for end in ends}
        if bodies <= self._bodies:
            first, second = (self._model.body(body).name for body in bodies)
            remedy = "in its place, let one joint follow another: <joint joint1=… joint2=… polycoef=…/>"
            raise InvalidInput(f"{equality.name} ties {first} to {second}, which closes a loop, and links must be a tree; {remedy}")
        if bodies & self._bodies:
            self.notes.append(f"{equality.name} ties the hand to something else: ignored")

    def _add_pulled(self, tendon: int) -> None:
        """Let the joints that one motor pulls by a tendon move in proportion; those that have their own motor or leader do not."""
        model, name, terms = self._model, self._model.tendon(tendon).name, self._tendons[tendon]
        leader, *rest = [
            joint for joint in terms if joint in self._joints - self._driven and terms[joint] and joint not in self.mimics
        ] or [-1]
        for joint in rest:
            slope = terms[joint] / terms[leader]
            self._tie(name, {joint: 1.0, leader: -slope}, 0.0, [joint])
            pair = f"{model.joint(leader).name} and {model.joint(joint).name}"
            self.notes.append(f"tendon {name} moves {pair} by one motor: the second follows the first, by {slope:g}")

    def _tie(self, what: str, terms: Terms, constant: float, followers: Sequence[int]) -> None:
        """Let the sum `terms` be constant: of two joints one follows the other, rather one without a motor, then one of `followers`."""
        model, terms = self._model, {joint: coefficient for joint, coefficient in terms.items() if coefficient}
        names = {joint: model.joint(joint).name for joint in terms}
        rest = {joint: model.joint(joint).qpos0.item() for joint in terms}
        if len(terms) == 1:
            self.held |= {joint: rest[joint] + constant / coefficient for joint, coefficient in terms.items()}
            return
        order = sorted(terms, key=lambda joint: (joint in self._driven, joint not in followers, -joint))
        free = [joint for joint in order if joint not in self.mimics]
        if len(terms) != 2 or not free:
            raise InvalidInput(f"{what} ties joints {', '.join(names.values())}; a joint can follow one other: delete what ties them")
        follower = free[0]
        (leader,) = set(terms) - {follower}
        slope = -terms[leader] / terms[follower]
        self.mimics[follower] = Mimic(names[leader], slope, rest[follower] + constant / terms[follower] - slope * rest[leader])
