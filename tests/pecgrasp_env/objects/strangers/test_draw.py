"""Strangers: what is drawn, that it is drawn again alike, and that it is none of the classes."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pec import classifier
from pecgrasp_env.objects import (
    CLASSES,
    LARS_CLASSES,
    UNKNOWN,
    DrawnStrangers,
    ObjectError,
    make_object,
    stranger,
    strangers_for,
)
from pecgrasp_env.objects.meshing.convex_hulls import convex_hull
from pecgrasp_env.objects.meshing.edges import Edges
from pecgrasp_env.objects.model import assemble
from pecgrasp_env.objects.procedural.strangers.draw import FORMS
from pecgrasp_env.objects.procedural.strangers.kin import kin_of
from pecgrasp_env.objects.procedural.strangers.likeness import ALIKE, Likeness


def members(*classes: str, each: int = 2):
    return [make_object(name, seed) for name in classes for seed in range(each)]


def test_their_class_is_the_word_by_which_a_classifier_refuses():
    assert classifier.UNKNOWN == UNKNOWN == stranger(0).class_name


@pytest.mark.parametrize("form", FORMS)
def test_a_form_is_closed_and_of_the_size_of_things_that_are_handled(form):
    for seed in range(2):
        pieces, mass = FORMS[form](np.random.default_rng(seed))
        assert 0.01 < mass <= 1.6
        for shape, _ in pieces:
            place = np.unique(shape.vertices.round(6), axis=0, return_inverse=True)[1].reshape(-1)
            faces = place[shape.faces]
            faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
            assert (Edges(faces).count % 2 == 0).all()  # no edge borders on one face only
        model = assemble(UNKNOWN, form, pieces, mass)
        assert 0.015 < model.extents.max() < 0.45
        assert all(len(hull) <= 60 and convex_hull(hull).volume > 0 for hull in model.hulls)
        assert model.volume > 0


def test_a_number_draws_the_same_thing_again_and_another_number_another():
    again = [stranger.__wrapped__(7).parts[0].vertices for _ in range(2)]
    np.testing.assert_array_equal(*again)
    assert len({stranger(i).extents.round(4).tobytes() for i in range(12)}) == 12


@pytest.mark.slow
def test_kin_by_name_is_left_out_whatever_a_folder_calls_it():
    assert {"mug", "cup", "pot", "shell"} <= kin_of(["coffee_mug"])
    assert {"box", "cuboid"} <= kin_of(["Boxes"])
    assert {"can", "cylinder"} <= kin_of(["007_tuna_can"])
    assert {"tool"} <= kin_of(["Hammers"])
    assert kin_of(["giraffe"]) & {*FORMS, *CLASSES} == set()
    kin_of_lars = kin_of(LARS_CLASSES) & {*FORMS, *CLASSES}
    assert kin_of_lars == {*LARS_CLASSES, "clamp", "wire_cutter", "open_wire_cutter"}
    drawn = {stranger(i, ("banana",)).instance.rpartition("_")[0] for i in range(60)}
    assert len(drawn) > 20
    assert "wand" not in drawn


def test_strangers_are_of_all_kinds_and_none_is_one_of_the_classes():
    models = members("stapler", "mug")
    source, like = DrawnStrangers(models, 20), Likeness(models)
    kinds = Counter(map(source.kind, range(20)))
    assert kinds.pop("composed") == 14
    assert kinds == {"of another class": 2, "out of proportion": 2, "cut off": 1, "pressed together": 1}
    drawn = strangers_for(models, 20)
    assert {model.class_name for model in drawn} == {UNKNOWN}
    assert [model.instance for model in drawn] == list(source.names)
    assert min(map(like.to_nearest, drawn)) >= ALIKE


def test_strangers_are_the_same_for_the_same_models_one_by_one():
    models = members("stapler")
    one, other = DrawnStrangers(models, 8, seed=3), DrawnStrangers(models, 8, seed=3)
    for i in (5, 3, 0):
        a, b = one.load(i), other.load(i)
        assert a.instance == b.instance
        np.testing.assert_array_equal(a.visual_mesh().vertices, b.visual_mesh().vertices)
    assert DrawnStrangers(models, 8, seed=4).load(0).extents.tolist() != one.load(0).extents.tolist()


def test_what_cannot_be_drawn_is_said():
    with pytest.raises(ObjectError, match="got none"):
        DrawnStrangers([], 3)
    with pytest.raises(ObjectError, match="must not be negative, got -1"):
        stranger(-1)
    with pytest.raises(ObjectError, match="strangers 0 to 1, asked for 2"):
        DrawnStrangers(members("mouse"), 2).load(2)
