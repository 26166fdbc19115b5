"""The data card: what it shows is what is in the set, and it needs nothing but itself."""

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from pec.data.dataset import CloudDataset
from pec.data.shards import CloudSample, Manifest, ShardRecord, shard_name, write_manifest, write_shard
from pec.data.splits import write_splits
from pec.errors import DatasetError
from pecgrasp_env.capture import write_card

HOSTILE = "<script>alert(1)</script>"


def dataset(directory, scenario="tabletop"):
    """Three clouds of one class at 0.5, 1 and 2 m, seen from above, from the side and from below; none of the other."""
    samples = []
    for i, (z, up) in enumerate(((0.5, (0, 0, -1)), (1.0, (0, -1, 0)), (2.0, (0, 0, 1)))):
        T = np.eye(4)
        T[2, 3], T[:3, 2] = z, up
        cloud = np.random.default_rng(i).normal(size=(64 * (i + 1), 3)) * 0.02 + (0, 0, z)
        samples.append(CloudSample(cloud.astype(np.float32), 0, 0, T, i, 0, 0.25 * i))
    record = write_shard(directory / shard_name(0), samples)
    rejected = {"hidden": 41, "too few points": 7}
    record = ShardRecord(record.file, 3, record.sha256, rejected, {"can/bad": "bad.ply is flat"})
    classes, zeros = ["can", HOSTILE], np.zeros(3, np.int64)
    instances = [{"name": "can_0", "class": "can", "origin": "procedural catalogue"}]
    camera = {"name": "424x240", "width": 424, "height": 240, "fx": 223.4, "min_depth": 0.105}
    config = {"scenario": scenario, "sensor": "d435"}
    write_splits(directory, CloudDataset(classes, [], zeros, zeros, ""), 0)
    write_manifest(
        directory, Manifest(classes, instances, [camera], config, 3, {"pecgrasp": "0"}, [record], complete=True)
    )
    return directory


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources, self.scripts = [], 0

    def handle_starttag(self, tag, attrs):
        self.scripts += tag == "script"
        self.sources += [value for name, value in attrs if name in ("src", "href")]


def test_the_card_shows_what_is_there(tmp_path):
    text = write_card(dataset(tmp_path)).read_text()
    for words in (
        "<b>3</b><span>labelled clouds",
        "hidden",
        "41",
        "bad.ply is flat",
        "424×240",
        "1.00",
        "D435 with its",
    ):
        assert words in text
    assert text.count("<img") == 3
    assert "sample 2: can_0, 192 points" in text
    # 0° is from above, 180° from below; distances from 0.5 to 2 m.
    assert re.search(r"0 °.*90 °.*180 °", text, re.DOTALL)
    assert re.search(r"0\.5 m.*1\.25 m.*2 m", text, re.DOTALL)
    assert "Hidden by others: 66.7% of the clouds" in text


def test_the_card_needs_nothing_from_elsewhere_and_runs_nothing_of_others(tmp_path):
    text = write_card(dataset(tmp_path)).read_text()
    links = Links()
    links.feed(text)
    assert links.sources
    assert all(source.startswith("data:") for source in links.sources)
    assert HOSTILE not in text
    assert links.scripts == 1  # the viewer's own, in the head
    picture = next(source for source in links.sources if source.startswith("data:image/png"))
    image = Image.open(io.BytesIO(base64.b64decode(picture.split(",")[1]))).convert("RGBA")
    alpha = np.asarray(image)[..., 3]
    assert alpha.max() == 255
    assert (alpha == 0).mean() > 0.2  # transparent: it lies on light and on dark pages


def test_the_same_data_give_the_same_card_and_no_data_give_an_error(tmp_path):
    first = write_card(dataset(tmp_path / "a")).read_bytes()
    assert write_card(tmp_path / "a").read_bytes() == first == write_card(dataset(tmp_path / "b")).read_bytes()
    with pytest.raises(DatasetError, match="no data set"):
        write_card(tmp_path)


def test_clouds_without_a_camera_have_no_distance(tmp_path):
    text = write_card(dataset(tmp_path, scenario="surface")).read_text()
    assert "Distance from the camera" not in text
    assert text.count("<img") == 3
