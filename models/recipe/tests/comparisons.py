"""Pairs and predictions of a few pixels, to compare."""

import numpy as np

from nunet_models.data.pairs import Pair
from nunet_models.evaluation.compare import Prediction


def a_pair(depth, identity="0"):
    depth = np.array(depth, np.float32)
    return Pair(identity, np.zeros((*depth.shape, 3), np.uint8), depth, None)


def answering(depth):
    return lambda _: Prediction(np.array(depth, np.float32), None)
