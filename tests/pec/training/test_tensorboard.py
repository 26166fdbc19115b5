"""What TensorBoard finds after a run, and what the run says of its costs."""

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from pec import PEC
from pec.networks.registry import build_model
from pec.training.costs import multiply_adds
from pec.training.loop import train


@pytest.fixture(scope="module")
def run(shapes, tmp_path_factory):
    output = tmp_path_factory.mktemp("tracked")
    protocol = {
        "epochs": 2,
        "batch_size": 32,
        "surface_forms": False,
    }  # with the witness of forms nothing would be wrong
    results = train(
        {
            "dataset": {"path": str(shapes)},
            "output": str(output),
            "protocol": protocol,
            "progress": False,
            "augment": {},
        }
    )
    events = EventAccumulator(str(output / "tensorboard"), size_guidance={"tensors": 0})
    events.Reload()
    return results, events


def test_curves_have_a_value_each_epoch(run):
    results, events = run
    for tag, curve in [
        ("loss/train", "train_loss"),
        ("accuracy/train", "train_accuracy"),
        ("loss/selection", "selection_loss"),
        ("accuracy/selection", "selection_accuracy"),
        ("learning_rate", "learning_rate"),
    ]:
        values = [event.value for event in events.Scalars(tag)]
        assert values == pytest.approx(results["curves"][curve])
        assert [event.step for event in events.Scalars(tag)] == [1, 2]


def test_classes_and_confusion_are_shown(run):
    results, events = run
    for name, share in results["best"]["test_per_class"].items():
        assert events.Scalars(f"accuracy_of_class/test_best/{name}")[0].value == pytest.approx(share)
        assert len(events.Scalars(f"accuracy_of_class/selection/{name}")) == 2
    assert {"confusion/best", "confusion/last"} <= set(events.Tags()["images"])


def test_wrong_answers_are_shown_as_clouds(run):
    results, events = run
    confusion = results["best"]["test_confusion"]
    wrong = sum(map(sum, confusion)) - sum(row[i] for i, row in enumerate(confusion))
    assert wrong > 0  # two epochs: it has hardly learnt anything
    clouds = {tag for tag in events.Tags()["tensors"] if tag.startswith("misclassified/") and "_VERTEX" in tag}
    assert len(clouds) == min(wrong, 12)
    truth, answer = next(iter(clouds)).split("/")[1].split("_taken_for_")
    assert confusion[results["classes"].index(truth)][results["classes"].index(answer)] > 0


def test_settings_and_costs_are_hyper_parameters(run):
    results, events = run
    content = events.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    values = HParamsPluginData.FromString(content).session_start_info.hparams
    assert values["parameters"].number_value == results["parameters"]
    assert values["protocol.learning_rate"].number_value == 0.002
    assert values["raw_cloud_ms"].number_value == results["costs"]["raw_cloud_ms"] > 0
    assert values["preprocess.ordering"].string_value == "anchors"


def test_multiply_adds_are_those_of_the_layers():
    assert round(multiply_adds(PEC(64, 5), 64) / 1e6, 1) == 2.3  # the "about 2.3 million" that are known of it
    assert multiply_adds(build_model("pointnet_vanilla", 64, 10), 64) == (
        64 * (3 * 64 + 64 * 64 + 64 * 64 + 64 * 128 + 128 * 1024) + 1024 * 512 + 512 * 256 + 256 * 10
    )
