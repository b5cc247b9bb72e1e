"""Whole training runs on a rule that is known: they learn it, go on after a kill, and report what they did."""

import hashlib
import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from labelled import sided_examples
from PIL import Image

import dvr_jax
from dvr_jax.cli import train as command
from dvr_jax.dataset.examples import Examples
from dvr_jax.dataset.shards import write_shard
from dvr_jax.errors import DvrError, run_command
from dvr_jax.logic import Action
from dvr_jax.model.batches import assemble_batch
from dvr_jax.model.export import load_parameters
from dvr_jax.model.history import History, read_history
from dvr_jax.model.network import initial_parameters
from dvr_jax.model.network_config import NetworkConfig
from dvr_jax.model.predictor import Predictor
from dvr_jax.model.training import evaluate_batch, train_step, weighted_loss
from dvr_jax.model.training_data import prepare_training_data
from dvr_jax.model.training_options import TrainOptions
from dvr_jax.model.training_run import train
from dvr_jax.operators import ground_scene
from dvr_jax.planning.feasibility import feasibility
from dvr_jax.scene.sampling import scene_of_seed
from dvr_jax.scene.types import Scene

EXAMPLES = sided_examples(16, 1)
SMALL = NetworkConfig(image_size=24, channels=(3, 4, 4), dense=32, hidden=64)
OPTIONS = TrainOptions(
    data=(),
    out=Path(),  # each test sets its own
    image_size=24,
    batch=15,
    least_feasible=5,
    batch_scenes=4,
    held_out=0.2,
    steps=24,
    log_every=4,
    validate_every=12,
    checkpoint_every=8,
    validation_scenes=4,
)


def quiet(line: str) -> None:
    pass


def test_loss_is_the_weighted_mean_over_steps_that_count() -> None:
    logits = jnp.asarray([[2.0, -1.0, 5.0]])
    target = np.array([[1.0, 0.0, 0.0]])
    weight = np.array([[1.0, 1.0, 0.0]])
    loss, total = weighted_loss(logits, target, weight, jnp.asarray(3.0))
    by_hand = (3 * -np.log(1 / (1 + np.exp(-2))) - np.log(1 - 1 / (1 + np.exp(1)))) / 4
    assert float(loss) == pytest.approx(by_hand) and float(total) == 4
    behind, _ = weighted_loss(jnp.asarray([[2.0, -1.0, -50.0]]), target, weight, jnp.asarray(3.0))
    assert float(behind) == float(loss)


def test_learns_which_arm_is_on_the_objects_side(tmp_path: Path) -> None:
    options = replace(OPTIONS, out=tmp_path, steps=240, log_every=20, checkpoint_every=240)
    options = replace(options, learning_rate=3e-3, mirror=False)
    data = prepare_training_data(options, EXAMPLES, None, quiet)
    assert data.positive_weight == pytest.approx(
        0.5
    )  # a third drawn of the feasible, the others half and half
    lines: list[str] = []
    train(replace(options, validate_every=120), data, SMALL, lines.append)
    parameters, _ = load_parameters(tmp_path / "network.npz")
    batch = assemble_batch(EXAMPLES, data.table, data.sampler.sequences, "dvr")
    _, _, logits = evaluate_batch(
        parameters, data.table.height, data.table.masks, batch, jnp.float32(1)
    )
    counts = batch.weight > 0
    assert np.mean((np.asarray(logits) > 0)[counts] == (batch.target > 0.5)[counts]) > 0.95

    # What the searches load says the same of a scene that was trained on, and files are there to look at.
    predictor = Predictor.load(tmp_path / "network.npz")
    scene = EXAMPLES.scenes[EXAMPLES.scene[data.sampler.sequences[0]]]
    encoding = predictor.encode_scene(scene)
    probabilities, _ = predictor.predict(encoding, encoding.initial_hidden(24), range(24))
    wanted = "left" if scene.objects[scene.goal_index].position[0] < 0 else "right"
    for action, probability in zip(encoding.grounding.actions, probabilities, strict=True):
        if action.operator == "grasp" and action.arguments[2] == scene.goal.object:
            assert (probability > 0.5) == (action.arguments[0] == wanted)
    records = read_history(tmp_path / "history.jsonl")
    assert [r["step"] for r in records if "validation/loss" in r] == [120, 240]
    assert {"validation/average_precision", "validation/top1"} <= records[-1].keys()
    assert any(path.name.startswith("events.out") for path in (tmp_path / "events").iterdir())
    assert Image.open(tmp_path / "curves.png").size[0] > 800
    assert any("held out: loss" in line for line in lines)


def test_greedy_sequences_that_no_label_knows_are_judged_once(tmp_path: Path) -> None:
    """And those that labels know are not asked about."""
    asked: list[tuple[Scene, tuple[Action, ...]]] = []

    def oracle(tasks: Sequence[tuple[Scene, tuple[Action, ...]]]) -> list[bool]:
        asked.extend(tasks)
        return [actions[0].arguments[0] == "left" for _, actions in tasks]

    options = replace(OPTIONS, out=tmp_path, validation_scenes=8, held_out=0.6)
    parameters = initial_parameters(SMALL, 0)
    by_labels = prepare_training_data(options, EXAMPLES, None, quiet).validation
    judged = prepare_training_data(options, EXAMPLES, None, quiet, oracle).validation
    assert by_labels is not None and judged is not None
    share = by_labels.measure(parameters)["top1"]
    figure = judged.measure(parameters)["top1"]
    number = len(judged.solutions)
    assert number >= 4 and len(asked) == round(number * (1 - share)) > 0
    assert figure == pytest.approx(
        share + sum(actions[0].arguments[0] == "left" for _, actions in asked) / number
    )
    for scene, actions in asked:
        ground_scene(scene).check_sequence(actions)
    assert judged.measure(parameters)["top1"] == figure and len(asked) == round(
        number * (1 - share)
    )


def test_the_planner_is_what_the_command_asks() -> None:
    scene = scene_of_seed(1, 0, 1)
    name = scene.goal.object
    arms = ("left", "right")
    tasks = [
        (scene, (Action("grasp", (arm, face, name)), Action("place", (arm, name, "goal"))))
        for arm in arms
        for face in ("+x", "+y")
    ]
    expected = [
        verdict.feasible for verdict in feasibility(scene, [actions for _, actions in tasks])
    ]
    assert command.are_feasible(tasks) == expected


def train_until_killed(options: TrainOptions) -> None:
    """What a process of its own does, which ends in the middle of a step without a chance to tidy up."""

    def say(line: str) -> None:
        if line.startswith("step      20"):  # after the checkpoint of step 16
            os.kill(os.getpid(), signal.SIGKILL)

    jax.config.update("jax_enable_x64", True)  # as in this one
    train(options, prepare_training_data(options, EXAMPLES, None, say), SMALL, say)


def test_a_killed_run_goes_on_to_the_same_result(tmp_path: Path) -> None:
    whole, cut = (replace(OPTIONS, out=tmp_path / name, cooldown=12) for name in ("whole", "cut"))
    train(whole, prepare_training_data(whole, EXAMPLES, None, quiet), SMALL, quiet)
    child = multiprocessing.get_context("spawn").Process(target=train_until_killed, args=(cut,))
    child.start()
    child.join()
    assert child.exitcode == -signal.SIGKILL
    lines: list[str] = []
    data = prepare_training_data(cut, EXAMPLES, None, lines.append)
    assert not lines  # rendered before
    train(cut, data, SMALL, lines.append)
    assert lines[0] == "continues at step 16"
    results = [load_parameters(options.out / "network.npz")[0] for options in (whole, cut)]
    for mine, theirs in zip(*map(jax.tree.leaves, results), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert read_history(whole.out / "history.jsonl") == read_history(cut.out / "history.jsonl")

    with pytest.raises(DvrError, match=r"training\.seed = 0, this run has 1"):
        train(replace(cut, seed=1), data, SMALL, quiet)
    with pytest.raises(DvrError, match=r"config\.hidden = 64, this run has 65"):
        train(cut, data, replace(SMALL, hidden=65), quiet)
    with pytest.raises(DvrError, match=r"training\.cooldown = 12 of 24 steps, this run has None"):
        train(replace(cut, steps=48), data, SMALL, quiet)
    with pytest.raises(DvrError, match=r"--steps is 10; the run in .* is already at step 24"):
        train(replace(cut, steps=10), data, SMALL, quiet)


def test_targets_that_nobody_has_looked_at_weigh_what_is_asked_for(tmp_path: Path) -> None:
    inside = np.arange(EXAMPLES.actions.shape[1]) < EXAMPLES.length[:, None]
    looked_at = np.arange(inside.size).reshape(inside.shape) % 3 > 0
    examples = EXAMPLES._replace(weight=(inside & looked_at).astype(np.float32))
    for unknown in (0.0, 0.25, 1.0):
        data = prepare_training_data(
            replace(OPTIONS, out=tmp_path, unknown=unknown), examples, None, quiet
        )
        expected = np.where(examples.weight > 0, 1, unknown) * inside
        np.testing.assert_array_equal(data.examples.weight, expected)
        assert data.validation is not None
        np.testing.assert_array_equal(data.validation.examples.weight, expected)


def test_a_step_is_adams(tmp_path: Path) -> None:
    options = replace(OPTIONS, out=tmp_path, steps=1, log_every=1, checkpoint_every=1, held_out=0.0)
    data = prepare_training_data(options, EXAMPLES, None, quiet)
    assert data.validation is None
    before = initial_parameters(SMALL, 0)
    after = train(options, data, SMALL, quiet)
    moved = jax.tree.map(lambda new, old: np.abs(np.asarray(new - old)), after.tree, before.tree)
    # Adam's first step is the learning rate in the direction of the gradient's sign, whatever its size.
    adam = optax.adam(options.learning_rate)
    expected, _ = adam.update(jnp.ones(1), adam.init(jnp.ones(1)))
    assert max(float(leaf.max()) for leaf in jax.tree.leaves(moved)) == pytest.approx(
        -float(expected[0]), rel=1e-3
    )


@pytest.mark.parametrize("cooldown", [0, 1, 8, 24])
def test_learning_rate_is_optaxs_schedule(
    cooldown: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rates: list[float] = []

    def recorded(*arguments: Any) -> Any:
        rates.append(float(arguments[5]))
        return train_step(*arguments)

    options = replace(OPTIONS, out=tmp_path, cooldown=cooldown, held_out=0.0)
    monkeypatch.setattr("dvr_jax.model.training_run.train_step", recorded)
    train(options, prepare_training_data(options, EXAMPLES, None, quiet), SMALL, quiet)
    schedule = optax.linear_schedule(options.learning_rate, 0.0, cooldown, options.steps - cooldown)
    assert rates == pytest.approx([float(schedule(count)) for count in range(options.steps)])


def test_command_trains_a_classifier_on_separate_held_out_scenes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    held_out = sided_examples(3, 9)

    def reader(paths: tuple[Path, ...], completions: int, k_max: int) -> Examples:
        assert (completions, k_max) == (3, 6)
        return held_out if paths == (Path("b"),) else EXAMPLES

    labels = write_shard(tmp_path / "labels.parquet", {0: EXAMPLES.scenes[0]}, [], {"seed": 0})
    monkeypatch.setattr("dvr_jax.dataset.examples.load_examples", reader)
    monkeypatch.setattr("dvr_jax.dataset.shards.find_shards", lambda paths: [labels])
    arguments = (
        "--data a --validation b --kind classifier --image-size 8 --batch 8 --least-feasible 2"
    )
    arguments += " --steps 4 --log-every 2 --checkpoint-every 4"
    monkeypatch.setattr(sys, "argv", ["train", *arguments.split(), "--out", str(tmp_path)])
    assert command.main() == 0
    assert "128 sequences to train on, 64 of them feasible" in capsys.readouterr().out
    predictor = Predictor.load(tmp_path / "network.npz")
    assert predictor.kind == "classifier" and not predictor.parameters.config.goal
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["command"] == f"python -m dvr_jax.train {arguments} --out {tmp_path}"
    assert (
        manifest["network"]["sha256"]
        == hashlib.sha256((tmp_path / "network.npz").read_bytes()).hexdigest()
    )
    assert manifest["counts"] == {"scenes": 16, "sequences": 128, "feasible": 64}
    assert manifest["labelled_by"] == [dvr_jax.__version__]
    last = read_history(tmp_path / "history.jsonl")[-1]
    assert manifest["held_out"] == last
    assert last.keys() == {"step", "validation/loss", "validation/average_precision"}


def test_held_out_scenes_are_not_those_that_are_trained_on(tmp_path: Path) -> None:
    with pytest.raises(
        DvrError, match="--validation has 16 of the scenes of --data; valid are others"
    ):
        prepare_training_data(replace(OPTIONS, out=tmp_path), EXAMPLES, EXAMPLES, quiet)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--seed 9223372036854775808", "--seed is 9223372036854775808; valid is 0 to 2^63 - 1."),
        ("--least-feasible 49", "--least-feasible is 49; valid is 0 to 48, the batch."),
        (
            "--checkpoint-every 150",
            "--checkpoint-every is 150; valid is a multiple of --log-every 100.",
        ),
        ("--cooldown 100001", "--cooldown is 100001; valid is 0 to 100000, the --steps."),
        ("--unknown 1.5", "--unknown is 1.5; valid is 0 to 1."),
        ("--batch-scenes 0", "--batch-scenes is 0; valid is 1 to 65,536."),
        ("--learning-rate 0", "--learning-rate is 0.0; valid is a positive number."),
        (
            "--image-size 2",
            "the images' size is 2 pixels; valid are multiples of 4 from 8 to 1024.",
        ),
        ("--held-out 1", "the held-out fraction is 1.0; valid is from 0 to below 1."),
    ],
)
def test_bad_options_end_with_one_sentence(
    option: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    examples = sided_examples(1, 0)
    monkeypatch.setattr("dvr_jax.dataset.examples.load_examples", lambda paths, **options: examples)
    monkeypatch.setattr(
        sys, "argv", ["train", "--data", "a", "--out", str(tmp_path), *option.split()]
    )
    with pytest.raises(SystemExit) as ended:
        run_command(command.main)
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"error: {message}\n"


def test_history_forgets_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    with History(tmp_path, 0) as history:
        for step in (10, 20, 30):
            history.add(step, "train", {"loss": 1 / step})
    with (tmp_path / "history.jsonl").open("a") as file:
        file.write('{"step": 40, "tra')
    with History(tmp_path, 20) as history:
        history.add(30, "train", {"loss": 0.5})
    assert [(r["step"], r["train/loss"]) for r in read_history(tmp_path / "history.jsonl")] == [
        (10, 0.1),
        (20, 0.05),
        (30, 0.5),
    ]


@pytest.mark.parametrize("line", ["5", "[1]", '{"train/loss": 1}', '{"step": "x"}', "nonsense"])
def test_what_is_no_history_is_refused(tmp_path: Path, line: str) -> None:
    path = tmp_path / "history.jsonl"
    path.write_text(line + '\n{"step": 2, "train/loss": 0.5}\n')
    with pytest.raises(DvrError, match=r"history\.jsonl, line 1: this is no record of a training"):
        read_history(path)


@pytest.mark.parametrize("place", [0, 5, 12, 30, 45])
def test_a_changed_record_is_noticed(tmp_path: Path, place: int) -> None:
    with History(tmp_path, 0) as history:
        for step in (10, 20):
            history.add(step, "train", {"loss": 1 / step})
    path = tmp_path / "history.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    with pytest.raises(DvrError, match=r"history\.jsonl, line 1: this is no record"):
        read_history(path)


def test_training_goes_on_from_the_last_intact_checkpoint(tmp_path: Path) -> None:
    options = replace(OPTIONS, out=tmp_path / "cut", steps=16)
    data = prepare_training_data(options, EXAMPLES, None, quiet)
    train(options, data, SMALL, quiet)
    damaged = next((tmp_path / "cut" / "checkpoints" / "16" / "rest").rglob("manifest.ocdbt"))
    damaged.write_bytes(damaged.read_bytes()[:-3])
    said: list[str] = []
    went_on = train(replace(options, steps=24), data, SMALL, said.append)
    assert "step 16: the file rest/" in said[0] and said[1] == "continues at step 8"
    whole = train(replace(options, out=tmp_path / "whole", steps=24), data, SMALL, quiet)
    assert all(
        np.array_equal(one, other)
        for one, other in zip(jax.tree.leaves(went_on), jax.tree.leaves(whole), strict=True)
    )
