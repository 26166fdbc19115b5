"""What is counted of known things and strangers, and the page that shows it."""

import re

import numpy as np
import pytest

from pec.data.dataset import CloudDataset
from pecgrasp_env.experiments.strangers import Answered, measure
from pecgrasp_env.experiments.strangers_page import render


def _part(known, names, truth, likeliest):
    n = len(known)
    clouds = [
        np.random.default_rng(i).normal(scale=0.03, size=(80, 3)).astype(np.float32) + np.float32([0, 0, 0.5])
        for i in range(n)
    ]
    dataset = CloudDataset(["any"], clouds, np.zeros(n, np.int64), np.arange(n), "")
    return Answered(dataset, np.array(names), np.array(truth), np.array(likeliest), np.array(known))


@pytest.fixture
def parts():
    mugs = ["mug/a", "mug/a", "mug/b", "mug/b"]
    pears = ["fruit/pear", "fruit/pear", "fruit/fig", "fruit/fig"]
    return {
        "known": _part([0.9, 0.8, 0.7, 0.3], mugs, ["mug"] * 4, ["mug", "can", "mug", "mug"]),
        "strangers": _part([0.6, 0.1, 0.1, 0.2], pears, ["fruit"] * 4, ["can", "mug", "mug", "mug"]),
    }


def test_shares_of_a_known_case(parts):
    results = measure(parts, 0.5)
    assert results["auc"] == 15 / 16
    known, strangers = results["parts"]["known"], results["parts"]["strangers"]
    assert (known["at"]["kept"], known["at"]["right"], known["likeliest_right"]) == (0.75, 0.5, 0.75)
    assert (strangers["at"]["kept"], strangers["instances"], strangers["clouds"]) == (0.25, 2, 4)
    assert strangers["at"]["interval"] == (0.0, 0.5)  # of two things, one is kept once in two
    assert results["threshold_95"] == pytest.approx(np.quantile([0.9, 0.8, 0.7, 0.3], 0.05))
    pear = next(row for row in results["instances"] if row["name"] == "fruit/pear")
    assert (pear["clouds"], pear["kept"], pear["right"], pear["taken_for"]) == (2, 0.5, None, {"can": 1, "mug": 1})
    roc = np.array(results["roc"])
    assert roc[0].tolist() == [0, 0]
    assert roc[-1].tolist() == [1, 1]
    assert (np.diff(roc, axis=0) >= 0).all()


def test_page_shows_what_was_mistaken_and_loads_nothing(parts):
    page = render(parts, measure(parts, 0.5), "some/best")
    assert "fruit/pear: can, known 0.60" in page
    assert "mug/b: mug, known 0.30" in page
    assert "fruit/fig: " not in page
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", page)
