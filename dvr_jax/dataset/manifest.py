"""What a folder of shards holds, in numbers and checksums: `_manifest.json`."""

import hashlib
import json
import shlex
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from dvr_jax.dataset.examples import labelled_sequences, scenes_of
from dvr_jax.dataset.footer import ShardInfo
from dvr_jax.dataset.shards import SUFFIX, list_shards, read_columns
from dvr_jax.errors import DvrError
from dvr_jax.runtime.files import write_whole

MANIFEST = "_manifest.json"
"""Readers of Parquet folders (pyarrow, pandas, DuckDB's and Spark's) take no file for data whose name begins so."""


@dataclass(slots=True)
class LabelCounts:
    """Counts over shards."""

    scenes: int = 0
    """Complete scenes, those without a label included."""
    solved: int = 0
    """Scenes with a feasible sequence."""
    feasible: int = 0
    """Labels."""
    infeasible: int = 0
    """Labels of single sequences."""
    refuted_prefixes: int = 0
    """Labels of prefixes."""
    shortest: dict[int, int] = field(default_factory=dict)
    """Number of scenes by the length of their shortest feasible sequence."""


def count_labels(infos: Iterable[ShardInfo]) -> LabelCounts:
    """Counts over the labels of shards."""
    counts, shortest = LabelCounts(), Counter[int]()
    for info in infos:
        columns = read_columns(info)
        counts.scenes += len(info.scenes)
        counts.feasible += int(columns.feasible.sum())
        counts.refuted_prefixes += int(columns.refuted_prefix.sum())
        counts.infeasible += int((~columns.feasible & ~columns.refuted_prefix).sum())
        lengths = columns.action_ends[1:] - columns.action_ends[:-1]
        for first, stop in zip(columns.label_ends[:-1], columns.label_ends[1:], strict=True):
            found = lengths[first:stop][columns.feasible[first:stop]]
            if len(found):
                shortest[int(found.min())] += 1
    counts.solved, counts.shortest = shortest.total(), dict(sorted(shortest.items()))
    return counts


def count_infeasible_sequences(infos: Iterable[ShardInfo], k_max: int) -> int:
    """Number of sequences of at most k_max actions that are known to be infeasible.

    These are labelled or under a refuted prefix; each counts once, also where both hold.
    """
    total = 0
    for info in infos:
        columns = read_columns(info)
        for row, symbols, _ in scenes_of(info, columns):
            labels = slice(*columns.label_ends[row : row + 2].tolist())
            sequences = labelled_sequences(columns, row, symbols, str(info))
            refuted = columns.refuted_prefix[labels].tolist()
            prefixes = {sequence for sequence, is_prefix in zip(sequences, refuted, strict=True) if is_prefix}
            rows = zip(sequences, columns.feasible[labels].tolist(), refuted, strict=True)
            for sequence, feasible, is_prefix in rows:
                if feasible or any(sequence[:length] in prefixes for length in range(len(sequence))):
                    continue
                most = k_max - len(sequence)
                total += symbols.count_up_to(symbols.state_after(sequence), most) if is_prefix else int(most >= 0)
    return total


def write_manifest(directory: str | Path, command: Sequence[str] | None = None) -> Path:
    """Write `_manifest.json` for the shards of a folder: command, seeds, options, versions, counts, checksums.

    `command` is what made them; without it, the command line of this process. Depends on nothing else than the shards,
    so the same shards give the same file.
    """
    directory = Path(directory)
    infos = list_shards(directory)
    if not infos:
        raise DvrError(f"there is no shard in {directory}; valid are files *{SUFFIX}.")
    footer = infos[0].footer
    counts = asdict(count_labels(infos))
    manifest = {
        "command": shlex.join(["python", *sys.orig_argv[1:]] if command is None else command),
        "seeds": footer.seeds,
        "options": footer.options,
        "domain": footer.domain,
        "versions": {
            name: sorted({info.footer.versions.get(name, "unknown") for info in infos}) for name in footer.versions
        },
        "counts": counts,
        "shards": [
            {
                "file": info.path.name,
                "scenes": [info.footer.first, info.footer.stop],
                "labels": info.footer.labels,
                "sha256": hashlib.sha256(info.path.read_bytes()).hexdigest(),
            }
            for info in infos
        ],
    }
    path = directory / MANIFEST
    write_whole(path, (json.dumps(manifest, indent=1, sort_keys=True) + "\n").encode())
    return path
