"""What chooses the best checkpoint of a run."""

from dataclasses import replace

import pytest

from nunet_models.export.collections import tiny_spec
from nunet_models.training.feed import FolderFeed, SetsFeed
from nunet_models.training.objective import objective
from nunet_models.training.settings import Settings
from nunet_models.zoo import SerialGraph, graph_spec

METRICS = {
    "miou": 0.5,
    "accuracy": 0.7,
    "mse": 0.04,
    "rmse": 0.2,
    "abs_rel": 0.1,
    "area_median": 0.03,
    "angle_deg": 12.0,
    "box_miou": 0.6,
}
"""Of every kind, so that a score cannot tell what was measured by the names that are there."""


def score(spec, component, feed):
    settings = Settings(component, epochs=1)
    return objective(SerialGraph(spec), settings).score(METRICS, feed)


@pytest.mark.parametrize(
    ("component", "feed", "expected"),
    [
        ("segmentation", FolderFeed, 0.5),
        ("segmentation", SetsFeed, 0.5),
        ("depth", FolderFeed, -0.2),
        ("depth", SetsFeed, -0.1),
        ("confidence", FolderFeed, -0.03),
        ("confidence", SetsFeed, -0.03),
    ],
)
def test_a_score_is_of_what_the_run_trains_whatever_else_was_measured(component, feed, expected):
    spec = replace(tiny_spec("wnet_c"), confidence=True)
    assert score(spec, component, feed) == expected


@pytest.mark.parametrize(("task", "expected"), [("normals", -12.0), ("objectness", 0.6)])
def test_an_inner_task_has_its_own_score(task, expected):
    spec = graph_spec("wnet_c", backbone="tiny", tasks=(task, "depth"))
    assert score(spec, f"{task}1", FolderFeed) == expected
