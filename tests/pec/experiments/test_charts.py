"""Charts: every point in its place, texts as they are, and SVG that refers to nothing and can stand beside others."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pec.experiments.chart_files import inline_svg, png, standalone_svg
from pec.experiments.charts import bars, confusion_matrix, curves, histogram, points_over_axes

HOSTILE = '</svg><script>"$x_1$" & it\'s</script>'
SVG = "{http://www.w3.org/2000/svg}"


def shape(figure, tip):
    """(left, top, right, bottom) of the first shape that has a tip, in pixels."""
    root = ElementTree.fromstring(standalone_svg(figure))
    group = next(each for each in root.iter(SVG + "g") if each.findtext(SVG + "title") == tip)
    x, y = np.array(re.findall(r"[\d.]+", group.find(SVG + "path").get("d")), float).reshape(-1, 2).T
    return x.min(), y.min(), x.max(), y.max()


@given(
    st.dictionaries(
        st.text(min_size=1, max_size=8, alphabet="ab<&µ$_\x00\n"),
        st.lists(st.tuples(st.floats(1e-3, 1e5), st.floats(-1e6, 1e6)), min_size=1, max_size=5),
        min_size=1,
        max_size=4,
    ),
    st.booleans(),
)
@settings(max_examples=15)
def test_every_point_lies_inside_its_axes(series, logarithmic):
    figure = points_over_axes(series, x_label="a < b", y_label="y", logarithmic=logarithmic)
    root = ElementTree.fromstring(standalone_svg(figure))
    assert len(list(root.iter(SVG + "title"))) == sum(map(len, series.values()))
    (left, right), (low, high) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    for x, y in (point for points in series.values() for point in points):
        assert left <= x <= right
        assert low <= y <= high


def test_a_chart_of_nothing_is_an_error_where_it_was_asked_for_and_else_left_out():
    with pytest.raises(ValueError, match="at least one finite point"):
        points_over_axes({"a": [(1.0, float("nan"))]}, x_label="x", y_label="y")
    assert (
        inline_svg(curves({}), "t") == inline_svg(bars([], "ms"), "t") == inline_svg(histogram(np.array([])), "t") == ""
    )


def test_a_confusion_matrix_says_each_count_and_the_shares_that_are_right():
    text = inline_svg(confusion_matrix(np.array([[3, 1], [0, 0]]), ["a", "b"]), "t")
    assert "a taken for b: 1 of 4" in text
    assert "75.0 %" in text
    assert ">–<" in text  # no cloud of class b, so no share


def test_a_bar_ten_times_as_long_ends_a_decade_further():
    figure = bars([("x", 2, 3), ("y", 20, 30), ("z", 200, 300)], "ms")
    tips = ("x: median 2 ms, most 3 ms", "y: median 20 ms, most 30 ms", "z: median 200 ms, most 300 ms")
    ends = [shape(figure, tip)[2] for tip in tips]
    assert ends[2] - ends[1] == pytest.approx(ends[1] - ends[0], abs=0.1) != 0


def test_bars_of_a_histogram_are_the_counts():
    figure = histogram(np.array([1.0, 1, 1, 2, 9]), "m", bins=4)
    tips = ("1 to 3 m: 4", "3 to 5 m: 0", "5 to 7 m: 0", "7 to 9 m: 1")
    heights = [bottom - top for _, top, _, bottom in (shape(figure, tip) for tip in tips)]
    assert heights[0] == pytest.approx(heights[3] * 4, rel=0.01)
    assert heights[1:3] == [0, 0]
    assert "4.5 to " in inline_svg(histogram(np.array([5.0, 5.0])), "t")
    assert "3.33 to " in inline_svg(histogram(np.array([5.0, 5.0]), log=True), "t")


def test_a_chart_in_a_page_has_the_pages_colours_and_nothing_that_another_chart_could_meet(outline):
    drawn = [confusion_matrix(np.eye(2, dtype=int), [HOSTILE, "b"]), curves({HOSTILE: [0.1, 0.9]})]
    drawn += [bars([(HOSTILE, 1, 2)], "ms"), points_over_axes({HOSTILE: [(1, 2)]}, x_label=HOSTILE, y_label="y")]
    text = "".join(inline_svg(figure, HOSTILE) for figure in drawn)
    seen = outline(text)
    assert seen.text.count(HOSTILE) >= 5
    assert (seen.ids, seen.addresses) == ([], [])
    assert not re.search(r"url\(|xmlns|<style|script>", text)
    assert {"var(--accent", "var(--ink", "var(--good", "var(--paper"} <= set(re.findall(r"var\(--\w+", text))


def test_the_same_chart_is_the_same_file():
    first, second = (points_over_axes({"a": [(1, 2), (3, 4)]}, x_label="x", y_label="y") for _ in range(2))
    assert standalone_svg(first) == standalone_svg(first) == standalone_svg(second)
    assert inline_svg(first, "t") == inline_svg(second, "t")
    assert png(first) == png(second)
    assert png(first).startswith(b"\x89PNG")
