"""A class of objects of one's own, by its dotted name."""

import pytest

from pecgrasp_env.objects import Catalogue, ObjectError, make_object, open_objects

SOURCE = """
from pecgrasp_env.objects.meshing.shapes import block

def brick(rng):
    return [(block(100, 50, rng.uniform(30, 60)), (0.7, 0.2, 0.1))], 0.5

colour = "red"
"""


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    (tmp_path / "bricks.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)


def test_instances_of_an_own_class_are_draws_by_seed(own_module):
    catalogue = Catalogue(["bricks.brick", "can"], instances_per_class=2, seed=5)
    assert catalogue.classes == ("bricks.brick", "can")
    assert catalogue.names("bricks.brick") == ["bricks.brick_0005", "bricks.brick_0006"]
    first, second = (catalogue.load("bricks.brick", i) for i in range(2))
    assert first.extents[:2] == pytest.approx([0.1, 0.05])
    assert 0.03 < first.extents[2] < 0.06
    assert first.extents[2] != second.extents[2]
    assert first.mass == 0.5
    assert open_objects(classes=["bricks.brick"]).load("bricks.brick", 3).class_name == "bricks.brick"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("brick", r"the catalogue has joypad, .* and module\.function of your own"),
        (
            "nowhere_at_all.brick",
            r"No module named 'nowhere_at_all'; is the folder of nowhere_at_all\.py on PYTHONPATH",
        ),
        ("bricks.colour", "bricks has no function colour"),
        ("bricks.stone", "bricks has no function stone"),
    ],
)
def test_what_is_no_class_is_named_with_the_way_out(own_module, name, message):
    with pytest.raises(ObjectError, match=message):
        make_object(name, 0)
    with pytest.raises(ObjectError, match=message):
        Catalogue([name])
