"""Decoded images, augmentation and batches."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nunet_models.classes import IGNORE
from nunet_models.data.augment import NO_AUGMENTATION, STRONG, Sample, augmented, zoomed
from nunet_models.data.batches import epoch_batches
from nunet_models.data.cache import build_cache
from nunet_models.data.pairs import DepthUnits, FolderPairs
from nunet_models.errors import DataError


def test_a_cache_gives_the_pairs_back_to_a_tenth_of_a_millimeter(pairs, tmp_path):
    cached = build_cache(pairs, tmp_path / "cache")
    pair = pairs[3]
    assert np.array_equal(cached.rgb[3], pair.rgb)
    assert np.array_equal(cached.labels[3], pair.labels)
    assert np.abs(cached.depth_m(3) - pair.depth_m).max() <= 1.01e-4


def test_a_second_run_decodes_nothing(pairs, tmp_path, monkeypatch):
    build_cache(pairs, tmp_path / "cache")
    monkeypatch.setattr(FolderPairs, "__getitem__", lambda *_: pytest.fail("decoded again"))
    assert len(build_cache(pairs, tmp_path / "cache")) == len(pairs)


def test_a_run_that_meets_another_while_decoding_uses_what_was_whole_first(
    pairs, tmp_path, monkeypatch
):
    read, theirs = FolderPairs.__getitem__, []

    def met(self, index):
        if index == 2 and not theirs:
            theirs.append(None)
            theirs[0] = build_cache(self, tmp_path / "cache")
        return read(self, index)

    monkeypatch.setattr(FolderPairs, "__getitem__", met)
    ours = build_cache(pairs, tmp_path / "cache")
    (place,) = (tmp_path / "cache").iterdir()
    for cached in (ours, theirs[0]):
        assert Path(cached.rgb.filename) == (place / "rgb.npy").resolve()
        assert np.array_equal(cached.rgb[1], read(pairs, 1).rgb)
        assert np.array_equal(cached.rgb[5], read(pairs, 5).rgb)


def test_a_decoding_that_fails_leaves_nothing_to_be_taken_for_whole(pairs, dataset, tmp_path):
    (dataset / "rgb" / "0003.png").write_bytes(b"\x89PNG no more")
    with pytest.raises(DataError):
        build_cache(pairs, tmp_path / "cache")
    assert not list((tmp_path / "cache").iterdir())


def test_labels_are_found_where_the_first_image_has_none(pairs, dataset, tmp_path):
    blank = np.full((96, 128), IGNORE, np.uint8)
    Image.fromarray(blank).save(dataset / "label40" / "0000.png")
    assert build_cache(pairs, tmp_path / "cache").has_labels
    for path in (dataset / "label40").iterdir():
        Image.fromarray(blank).save(path)
    assert not build_cache(pairs, tmp_path / "other").has_labels


def test_depth_beyond_the_cache_s_reach_is_none_and_counted(dataset, tmp_path, capsys):
    path = dataset / "depth" / "0000.png"
    values = np.full((96, 128), 13_107, np.uint16)
    values[2, :5] = 13_108
    Image.fromarray(values).save(path)
    pairs = FolderPairs(dataset, ["0000"], units=DepthUnits())
    for _ in range(2):  # decoded, then found
        cached = build_cache(pairs, tmp_path / "cache")
        assert "rooms, 1 images: 5 pixels of depth beyond 13.1 m" in capsys.readouterr().err
    depth_m = cached.depth_m(0)
    assert np.isnan(depth_m[2, :5]).all()
    assert depth_m[2, 5] == pytest.approx(13.107)


@pytest.mark.parametrize("what", ["an older file", "another size"])
def test_a_replaced_image_is_not_served_from_the_cache(dataset, tmp_path, what):
    path = dataset / "depth" / "0000.png"
    ids = ["0000", "0001"]
    before = build_cache(FolderPairs(dataset, ids, units=DepthUnits()), tmp_path / "cache")
    known = path.stat()
    Image.fromarray(np.full((96, 128), 1234, np.uint16)).save(path)
    time_ns = known.st_mtime_ns - (10**9 if what == "an older file" else 0)
    os.utime(path, ns=(time_ns, time_ns))
    assert path.stat().st_size != known.st_size
    after = build_cache(FolderPairs(dataset, ids, units=DepthUnits()), tmp_path / "cache")
    assert before.depth_m(0)[9, 9] != after.depth_m(0)[9, 9] == pytest.approx(1.234, abs=2e-4)


def test_other_units_are_not_served_from_the_cache(dataset, tmp_path):
    one, other = (
        build_cache(FolderPairs(dataset, ["0000"], units=DepthUnits(scale)), tmp_path / "cache")
        for scale in (0.001, 0.002)
    )
    assert other.depth_m(0)[9, 9] == pytest.approx(2 * one.depth_m(0)[9, 9], rel=1e-3)


def a_sample(size=(96, 128)):
    rows = np.arange(size[0], dtype=np.float32)[:, None] * np.ones(size[1], np.float32)
    rgb = np.repeat(rows[..., None], 3, axis=2).astype(np.uint8)
    return Sample(rgb, rows + 1.0, (rows // 40).astype(np.uint8))


def test_without_augmentation_the_image_is_downsampled_by_area():
    sample = a_sample()
    out = augmented(sample, NO_AUGMENTATION, size=(48, 64), random=np.random.default_rng(0))
    mean = sample.rgb.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3))
    assert np.abs(out.rgb - mean).max() <= 0.5
    assert out.depth_m.shape == (48, 64)


def test_a_zoom_divides_depth_by_its_factor():
    out = zoomed(a_sample(), 2.0, size=(96, 128), corner=np.array([0.0, 0.0]))
    assert out.depth_m[0, 0] == pytest.approx(0.5)
    assert out.depth_m.max() == pytest.approx(48 / 2)  # the lower half lies outside the window


def test_a_zoom_below_one_leaves_a_margin_without_truth():
    out = zoomed(a_sample(), 0.5, size=(96, 128), corner=np.array([0.5, 0.5]))
    assert np.isnan(out.depth_m[0]).all() and (out.labels[0] == IGNORE).all()
    assert out.depth_m[48, 64] == pytest.approx(2.0 * 49, rel=0.05)
    assert (out.rgb[0] == 127).all()


def test_strong_augmentation_keeps_dtypes_and_plausible_depth():
    for seed in range(20):
        out = augmented(a_sample(), STRONG, size=(48, 64), random=np.random.default_rng(seed))
        assert (out.rgb.dtype, out.depth_m.dtype, out.labels.dtype) == (
            np.uint8,
            np.float32,
            np.uint8,
        )
        known = out.depth_m[np.isfinite(out.depth_m)]
        assert known.min() >= 1 / 1.6 - 1e-6 and known.max() <= 96 / 0.85 + 1e-3


def test_batches_of_a_seed_and_epoch_are_the_same_from_any_start(pairs, tmp_path):
    cached = build_cache(pairs, tmp_path / "cache")
    how = dict(size=(48, 64), batch=2, seed=3, epoch=1, workers=0)
    whole = list(epoch_batches(cached, STRONG, **how))
    rest = list(epoch_batches(cached, STRONG, first=1, **how))
    assert len(whole) == 3 and len(rest) == 2
    assert (whole[1].rgb == rest[0].rgb).all()
    assert whole[1].depth_m.nan_to_num(0).equal(rest[0].depth_m.nan_to_num(0))


def test_another_epoch_draws_other_images(pairs, tmp_path):
    cached = build_cache(pairs, tmp_path / "cache")
    one, other = (
        next(epoch_batches(cached, STRONG, size=(48, 64), batch=2, seed=3, epoch=e, workers=0))
        for e in (0, 1)
    )
    assert not (one.rgb == other.rgb).all()
