"""How the rows of a data directory, remade or published, differ from those of a recipe."""

from collections.abc import Collection
from dataclasses import dataclass, field

from pipeline.console import abbreviate, pluralise
from pipeline.errors import InvalidInput
from pipeline.recipes.recipe import Recipe, roots_of
from pipeline.store.directory import DataDirectory, shard_of
from schemas.catalogue import ARTIFACTS


@dataclass
class Comparison:
    """How a data directory differs from a recipe."""

    compared: int = 0  # number of rows compared
    # objects by the first stage in which their row differs
    differing: dict[str, list[str]] = field(default_factory=dict)
    following: int = 0  # number of rows of later stages that differ too
    absent: dict[str, list[str]] = field(default_factory=dict)  # objects without a row, by stage
    remarks: list[str] = field(default_factory=list)  # other differences, as sentences

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return not (self.differing or self.absent or self.remarks)


def compare(
    recipe: Recipe,
    directory: DataDirectory,  # remade or published; only records are read: `validate` compares arrays with these
    names: Collection[str] | None = None,  # only the rows of these objects, without the roots; by default all
) -> Comparison:
    """Compare the digests of a data directory's records with those of a recipe."""
    comparison, differing_before = Comparison(), set[str]()
    selected = recipe.rows.keys() if names is None else names
    made_by = {artifact.stage: artifact for artifact in ARTIFACTS.values()}
    for number, (stage, expected) in enumerate(recipe.stages.items()):
        if stage not in made_by:
            raise InvalidInput(f"no artifact here is made by {stage}, which the recipe has; use the version that wrote it")
        collection = directory.collection(made_by[stage])
        stored = {name: (collection.row(name).digest, collection.row(name).split) for name in collection}
        present = [name for name in selected if name in stored]
        if len(present) < len(selected):
            comparison.absent[stage] = [name for name in selected if name not in stored]
        if not present:
            continue
        comparison.compared += len(present)
        differing = [name for name in present if not stored[name][0].startswith(recipe.rows[name].digests[number])]
        constants = collection.first.record.constants_digest
        if constants != expected.constants:
            comparison.remarks.append(f"{stage}: the arrays that all objects share differ")
        if names is None and len(present) == len(selected):
            if extra := sorted(stored.keys() - recipe.rows.keys()):
                comparison.remarks.append(f"{stage}: {pluralise(len(extra))} not in the recipe ({abbreviate(extra)})")
            rows = {name: stored[name] for name in recipe.rows}
            roots = roots_of(rows, expected.constants, recipe.shards)  # where constants differ, the remark above says so
            agrees = [root == expected_root for root, expected_root in zip(roots, expected.roots, strict=True)]
            differing = _without_misprints(stage, differing, agrees, comparison)
        if newly_differing := [name for name in differing if name not in differing_before]:
            comparison.differing[stage] = newly_differing
        comparison.following += len(differing) - len(newly_differing)
        differing_before.update(differing)
    return comparison


def _without_misprints(stage: str, differing: list[str], agrees: list[bool], comparison: Comparison) -> list[str]:
    """Compare roots with rows: if the root of a shard agrees, so do its rows, and a digest that differs is an error in the recipe."""
    shards = len(agrees)
    if wrong := [name for name in differing if agrees[shard_of(name, shards)]]:
        comparison.remarks.append(f"{stage}: the recipe's digests of {abbreviate(wrong)} are wrong, for the roots of their shards agree")
    remaining = [name for name in differing if not agrees[shard_of(name, shards)]]
    explained = {shard_of(name, shards) for name in remaining}
    if roots := [str(number) for number, agreed in enumerate(agrees) if not agreed and number not in explained]:
        comparison.remarks.append(
            f"{stage}: each row agrees, but not the root of shard {abbreviate(roots)}: a root, or the split of an object, is wrong in the "
            "recipe"
        )
    return remaining
