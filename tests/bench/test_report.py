"""Figures in documents: replaced between their markers, checked without a change, and up to date in this repository."""

import json
from pathlib import Path
from typing import Any

import pytest

import dvr_jax
from dvr_jax import __version__
from dvr_jax.bench import report
from dvr_jax.bench.committed import CommittedResults, MissingResultsError
from dvr_jax.bench.figures import FIGURES
from dvr_jax.bench.metrics import Direction, Metric, save_metrics
from dvr_jax.bench.recall_metrics import Counts, to_metrics
from dvr_jax.errors import DvrError

REPOSITORY = Path(dvr_jax.__file__).parents[1]


def planned(
    scene: int, length: int, total: float, proposed: int = 1, paths: int = 1
) -> dict[str, Any]:
    """A row of a planned scene; of length 0 it is unsolved."""
    return {
        "scene": scene,
        "status": "solved" if length else "tree exhausted",
        "words": ["left grasps blue at its +x face"] * length,
        "seconds": {"image": 0.1 * total, "network": 0.05 * total, "total": total},
        "nlps": {"path": paths},
        "verdicts": {"leaf": proposed, "path": 1},
        "rejected": 0,
        "passed": length > 0,
    }


def write_rows(
    repository: Path, name: str, rows: list[dict[str, Any]], version: str = "1.2", **options: Any
) -> None:
    """A results file as the benchmarks write it."""
    path = repository / "bench/results" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {
        "options": {
            "objects": 2,
            "shape": "box",
            "seed": 2,
            "search": "dvr",
            "time_limit": 60.0,
            **options,
        },
        "machine": "Abacus",
        "cores": 3,
        "versions": {"dvr_jax": version},
    }
    path.write_text("".join(json.dumps(row) + "\n" for row in [header, *rows]))


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with results made by hand."""
    write_rows(
        tmp_path,
        "search/dvr.jsonl",
        [
            planned(0, 2, 0.1),
            planned(1, 2, 0.3, proposed=5),
            planned(2, 4, 2.0, paths=3),
            planned(3, 0, 9.0),
        ],
    )
    write_rows(
        tmp_path,
        "search/classifier.jsonl",
        [planned(0, 2, 0.2), planned(1, 2, 0.2), planned(2, 4, 20.0), planned(3, 0, 9.5)],
        search="classifier",
    )
    # Scene 1 has another length, so it is no part of the speed-up.
    write_rows(
        tmp_path,
        "search/mbts.jsonl",
        [planned(0, 2, 0.2), planned(1, 3, 0.4), planned(2, 4, 250.0), planned(3, 0, 12.34)],
        search="mbts",
    )
    write_rows(
        tmp_path, "dvr_one_box.jsonl", [planned(0, 2, 0.1), planned(1, 0, 1.0)], objects=1, seed=1
    )
    write_rows(
        tmp_path,
        "mbts_cylinders.jsonl",
        [planned(0, 2, 0.1)],
        "1.3",
        shape="cylinder",
        search="mbts",
    )
    return tmp_path


def cells(text: str, title: str) -> list[str]:
    """The cells of the first row of a table that begins with this title."""
    line = next(line for line in text.splitlines() if line.startswith(f"| {title} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_the_headline_is_beside_the_paper(repository: Path) -> None:
    text = FIGURES["headline"](CommittedResults(repository))
    assert cells(text, "seconds from image to checked motion (median)") == [
        "0.200",
        "–",
        "2.00",
        "–",
        "–",
    ]
    assert cells(text, "path NLPs solved (median)") == ["1", "–", "3", "–", "–"]
    assert cells(text, "speed-up over multi-bound tree search (median)") == [
        "2.0",
        "–",
        "125",
        "–",
        "–",
    ]
    assert "| … in the paper | – | – | 46 | 100 | 705 |" in text
    assert (
        "solved: 3 of 3 (paper: 2,702 of 2,705). Measured with version 1.2 (Abacus, 3 cores)."
        in text
    )


def test_the_table_of_searches_counts_proposals(repository: Path) -> None:
    text = FIGURES["search-table"](CommittedResults(repository))
    assert cells(text, "network: scenes") == ["2", "–", "1", "–", "–"]
    assert cells(text, "network: sequences proposed, mean") == ["3.00", "–", "1.00", "–", "–"]
    assert cells(text, "network: the first sequence proposed is right") == [
        "50 %",
        "–",
        "100 %",
        "–",
        "–",
    ]
    assert cells(text, "multi-bound tree search: scenes") == ["1", "1", "1", "–", "–"]


def test_the_summary_names_longer_plans_and_unsolved_scenes(repository: Path) -> None:
    text = FIGURES["search-summary"](CommittedResults(repository))
    assert "4 scenes of 2 boxes (seed 2), 60 s each." in text
    assert "the network takes 5.0 %, the depth image 10.0 %" in text
    assert "Of the 3 scenes that both solve" in text and "tree search in 0, fewer in 1." in text
    assert (
        "9.00 s by the network, 9.50 s by the classifier, 12.3 s by multi-bound tree search" in text
    )


def test_scenes_name_the_version_where_there_are_several(repository: Path) -> None:
    text = FIGURES["scenes"](CommittedResults(repository))
    one_box = cells(text, "2 of 1 box, seed 1 (version 1.2)")
    assert one_box == ["`dvr`", "1", "1", "1", "0", "1 / 0 / 0 / 0 / 0", "0.100 / – / – / – / –"]
    assert cells(text, "1 of 2 cylinders, seed 2 (version 1.3)")[:2] == ["`mbts`", "1"]
    assert "Measured with version 1.2 (Abacus, 3 cores) and version 1.3 (Abacus, 3 cores)." in text


def test_metrics_become_tables(repository: Path) -> None:
    folder = repository / "bench/results"
    save_metrics(
        folder / "speed.json",
        "speed",
        [
            Metric("path NLPs of length 2", 13.42, "ms", Direction.LOWER, 0.05),
            Metric("path NLPs of length 2: feasible", 53, "problems", Direction.HIGHER, 0.0),
        ],
    )
    counts = Counts(problems=10, oracle=8, ours=7, both=6)
    save_metrics(
        folder / "recall.json",
        "recall",
        to_metrics([("keyframes", "all", counts), ("path", "all", counts)], [True, True, False]),
    )
    results = CommittedResults(repository)
    assert cells(FIGURES["speed"](results), "path NLPs of length 2") == ["13.4", "ms"]
    assert cells(FIGURES["speed"](results), "path NLPs of length 2: feasible") == ["53", "problems"]
    text = FIGURES["recall"](results)
    assert cells(text, "keyframes") == ["10", "8", "6 (75.0 %)", "1"]
    assert "Of 3 feasible paths, 2 pass the independent check." in text
    assert f"version {__version__} " in text


def test_labels_are_weighted_by_their_number(repository: Path) -> None:
    rows = [
        {"label": 0, "verdict": "feasible", "confirmed": False, "planned again": True},
        {"label": 1, "verdict": "infeasible by pose", "confirmed": True, "planned again": None},
        {"label": 2, "verdict": "infeasible by check", "confirmed": False, "planned again": None},
    ]
    write_rows(repository, "labels.jsonl", rows)
    path = repository / "bench/results/labels.jsonl"
    header, *lines = path.read_text().splitlines(keepends=True)
    totals = {"totals": {"feasible": 10, "infeasible by pose": 999, "infeasible by check": 1}}
    path.write_text(json.dumps({**json.loads(header), **totals}) + "\n" + "".join(lines))
    text = FIGURES["labels"](CommittedResults(repository))
    assert cells(text, "infeasible by pose") == ["1 of 1", "100.0 %", "999"]
    assert (
        "that the starts miss: 1; for 1 of them" in text
        and "99.90 % of the infeasible ones hold" in text
    )


def test_figures_are_written_between_their_markers(
    repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = repository / "README.md"
    page = repository / "docs/deep/page.md"
    page.parent.mkdir(parents=True)
    inline = "It solves <!-- figures: solved -->old<!-- end figures --> scenes."
    readme.write_text(
        f"# Title\n\n{inline}\n\n<!-- figures: headline -->\n<!-- end figures -->\n\nEnd.\n"
    )
    page.write_text("<!-- figures: speed -->\nkept\n<!-- end figures -->\n")
    before = readme.read_text()
    arguments = ["--repository", str(repository)]

    # The check names what would change, changes nothing, and passes over figures without results.
    assert report.run([*arguments, "--check"]) == report.EXIT_OUTDATED
    printed = capsys.readouterr().out
    assert "README.md does not show" in printed and "page.md" not in printed
    assert readme.read_text() == before

    assert report.run(arguments) == 0
    written = readme.read_text()
    assert "It solves <!-- figures: solved -->3 of 3<!-- end figures --> scenes." in written
    assert "<!-- figures: headline -->\n\n| actions of the plan |" in written and written.endswith(
        "\n\nEnd.\n"
    )
    assert "*No figures: bench/results/speed.json is missing.*" in page.read_text()

    # Once written, nothing changes any more.
    assert report.run([*arguments, "--check"]) == 0
    assert report.run(arguments) == 0
    assert readme.read_text() == written


def test_markers_that_cannot_be_are_refused(repository: Path) -> None:
    results = CommittedResults(repository)
    with pytest.raises(DvrError, match=r"page\.md: there is no figure 'nix'; valid: headline, "):
        report.fill_figures("<!-- figures: nix --><!-- end figures -->", results, "page.md")
    with pytest.raises(DvrError, match="the figure 'solved' has no end"):
        report.fill_figures("<!-- figures: solved -->", results, "page.md")
    with pytest.raises(DvrError, match="the figure 'solved' has no end"):
        two = "<!-- figures: solved --> <!-- figures: solved --><!-- end figures -->"
        report.fill_figures(two, results, "page.md")


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DvrError, match="has no folder bench/results"):
        report.run(["--repository", str(tmp_path)])


@pytest.mark.skipif(
    not (REPOSITORY / "bench/results").is_dir(), reason="the package is installed without results"
)
class TestThisRepository:
    """The committed documents and results."""

    @pytest.mark.parametrize("name", FIGURES)
    def test_every_figure_can_be_written(self, name: str) -> None:
        try:
            text = FIGURES[name](CommittedResults(REPOSITORY))
        except MissingResultsError as error:
            pytest.skip(str(error))
        assert text and "nan" not in text

    def test_readme_and_docs_show_the_committed_results(self) -> None:
        documents = report.documents(REPOSITORY)
        if not documents:
            pytest.skip("there are no documents")
        outdated = []
        for path in documents:
            text = path.read_text(encoding="utf-8")
            if (
                report.fill_figures(
                    text, CommittedResults(REPOSITORY), path.name, skip_missing=True
                )
                != text
            ):
                outdated.append(str(path.relative_to(REPOSITORY)))
        assert outdated == [], "python -m dvr_jax.bench report writes their figures"

    def test_results_of_table_one_are_the_papers(self) -> None:
        assert "25 of 25 cells" in FIGURES["table1"](CommittedResults(REPOSITORY))
