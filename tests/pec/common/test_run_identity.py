"""Whether two runs are the same, and what the first difference between them is."""

from pec.common.run_identity import files_key, first_difference, flat_settings, settings_key


def test_first_difference_is_named_as_an_override_names_it():
    before = {"model": {"name": "pec", "layers": (3, 4)}, "seed": 1, "epochs": 2}
    assert first_difference(before, before) is None
    assert first_difference(before, before | {"model": {"name": "pec", "layers": [3, 4]}}) is None
    assert first_difference(before, before | {"epochs": 3, "seed": 5}) == "seed=1, not 5"
    assert (
        first_difference(before, before | {"model": {"name": "pec2", "layers": [3]}}) == "model.name='pec', not 'pec2'"
    )


def test_what_an_older_version_did_not_have_counts_as_none():
    assert first_difference({"a": 1}, {"a": 1, "b": None}) is None
    assert first_difference({"a": 1}, {"a": 1, "b": {"c": 2}}) == "b.c=None, not 2"
    assert first_difference({"a": 1, "b": 0}, {"a": 1}) == "b=0, not None"


def test_keys_differ_where_the_settings_do():
    key = settings_key({"a": 1, "b": [2, None]}, "code")
    assert len(key) == 16
    assert key == settings_key({"b": (2, None), "a": 1}, "code")
    assert len({key, settings_key({"a": 1, "b": [2, None]}), settings_key({"a": 1, "b": [2, 0]}, "code")}) == 3


def test_key_of_files_is_that_of_their_contents(tmp_path):
    for name, content in (("a", "1"), ("b", "2"), ("c", "1")):
        (tmp_path / name).write_text(content)
    a, b, c = (tmp_path / name for name in "abc")
    assert files_key([a, b]) == files_key([c, b])
    assert len({files_key([a]), files_key([b]), files_key([a, b]), files_key([b, a])}) == 4


def test_flat_names():
    assert flat_settings({"a": {"b": 1, "c": {"d": [2]}}, "e": None}) == {"a.b": 1, "a.c.d": [2], "e": None}
