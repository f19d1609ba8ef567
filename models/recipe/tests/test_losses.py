"""Losses against values worked out by hand."""

import math

import pytest
import torch

from nunet_models import losses
from nunet_models.classes import IGNORE
from nunet_models.errors import ConfigError, OptionError

NAN = float("nan")


def image(*values):
    return torch.tensor(values, dtype=torch.float32).reshape(1, 1, 1, -1)


def test_mse_skips_pixels_without_truth():
    # ((1-2)^2 + (3-5)^2) / 2
    assert losses.mse(image(1, 3, 9), image(2, 5, NAN)).item() == pytest.approx(2.5)


def test_l1_is_the_mean_absolute_error():
    assert losses.l1(image(1, 3), image(2, 5)).item() == pytest.approx(1.5)


def test_scale_invariant_with_lambda_zero_is_the_squared_error_of_log1p():
    # d = ln 3 - ln 2, 0
    value = losses.scale_invariant(image(2, 3), image(1, 3), lam=0.0).item()
    assert value == pytest.approx(math.log(3 / 2) ** 2 / 2, rel=1e-6)


def test_scale_invariant_is_the_paper_s_published_formula():
    # n = 3, lambda 0.5; d = ln 2 - ln 4, ln 5 - ln 3, 0
    d = (math.log(2 / 4), math.log(5 / 3), 0.0)
    expected = sum(x * x for x in d) / 3 - 0.5 / (3 * 3) * sum(d) ** 2
    value = losses.scale_invariant(image(1, 4, 2), image(3, 2, 2)).item()
    assert value == pytest.approx(expected, rel=1e-6)


def test_scale_invariant_takes_each_image_alone_and_its_known_pixels():
    # d = ln 2 everywhere in the one, and in the one known pixel of the other
    predicted = torch.cat([image(1, 3), image(5, 9)])
    truth = torch.cat([image(0, 1), image(2, NAN)])
    value = losses.scale_invariant(predicted, truth, lam=0.5).item()
    assert value == pytest.approx(0.5 * math.log(2) ** 2, rel=1e-5)


def test_scale_invariant_clips_at_1e_7_and_adds_one():
    # a prediction below 0 counts as 1e-7: d = ln(1 + 1e-7) - ln 2
    value = losses.scale_invariant(image(-3), image(1), lam=0.0).item()
    assert value == pytest.approx(math.log(2 / (1 + 1e-7)) ** 2, rel=1e-6)


@pytest.mark.parametrize("lam", [-0.1, 1.0, NAN])
def test_scale_invariant_refuses_lambda_outside_its_range(lam):
    with pytest.raises(ConfigError, match="0 <= lambda < 1"):
        losses.scale_invariant(image(1), image(1), lam=lam)


def test_a_loss_may_say_its_lambda():
    weights = losses.parse_loss("scale_invariant:0.85=2, mse")
    assert weights == {"scale_invariant:0.85": 2.0, "mse": 1.0}
    weights = {"scale_invariant:0.85": 2.0}
    value = losses.weighted_depth_loss(image(1, 3), image(0, 1), weights=weights, log_network=False)
    # d = ln 2 everywhere
    assert value.item() == pytest.approx(2 * 0.15 * math.log(2) ** 2, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("scale_invariant:1=1", "is 1.0; expected 0 <= lambda < 1"),
        ("scale_invariant:-0.1", "is -0.1; expected 0 <= lambda < 1"),
        ("scale_invariant:much", "lambda `much`"),
        ("l1:0.5", "loss `l1` has no lambda"),
    ],
)
def test_a_lambda_that_does_not_fit_is_refused(text, word):
    with pytest.raises(ConfigError, match=word):
        losses.parse_loss(text)


def test_msle_is_the_squared_difference_of_log1p():
    value = losses.msle(image(1, 0), image(3, 0)).item()
    assert value == pytest.approx((math.log(2) - math.log(4)) ** 2 / 2, rel=1e-5)


def test_berhu_is_linear_below_c_and_quadratic_above():
    # errors 1 and 10, c = 2: 1 and (100 + 4) / 4 = 26
    assert losses.berhu(image(1, 10), image(0, 0)).item() == pytest.approx((1 + 26) / 2)


def test_silog_is_the_root_with_lambda_085():
    # d = 1 everywhere: sqrt(1 - 0.85)
    assert losses.silog(image(2, 3), image(1, 2)).item() == pytest.approx(math.sqrt(0.15), rel=1e-5)


def test_silog_treats_each_image_alone():
    one = losses.silog(image(2, 3), image(1, 2))
    other = losses.silog(image(5, 2), image(1, NAN))
    both = losses.silog(
        torch.cat([image(2, 3), image(5, 2)]), torch.cat([image(1, 2), image(1, NAN)])
    )
    assert both.item() == pytest.approx((one.item() + other.item()) / 2, rel=1e-6)


def test_gradient_matching_ignores_a_constant_offset():
    truth = torch.rand(1, 1, 16, 16)
    assert losses.gradient_matching(truth + 0.7, truth).item() == pytest.approx(0.0, abs=1e-6)


def test_gradient_matching_of_a_slope_grows_with_the_scale():
    # d rises by 1 a column: steps of 1, 2, 4, 8 across, none down; each mean halves by the
    # direction without change (equal counts in a square), so (1 + 2 + 4 + 8) / 2 / 4
    d = torch.arange(16.0).expand(1, 1, 16, 16)
    assert losses.gradient_matching(d, torch.zeros_like(d)).item() == pytest.approx(15 / 8)


def test_gradient_matching_drops_steps_to_unknown_pixels():
    d = image(0, 5, 1).expand(1, 1, 1, 3)
    truth = image(0, NAN, 0)
    # at scale 1 both steps touch the unknown pixel; at scale 2 pixels 0 and 2 remain: step 1
    assert losses.gradient_matching(d, truth).item() == pytest.approx(1 / 4)


def test_cross_entropy_skips_ignored_pixels():
    logits = torch.tensor([[0.0, 0.0], [0.0, 9.0]]).reshape(1, 2, 1, 2)
    labels = torch.tensor([[[1, IGNORE]]])
    assert losses.cross_entropy(logits, labels).item() == pytest.approx(math.log(2), rel=1e-6)


def test_a_loss_is_parsed_by_name_and_weight():
    assert losses.parse_loss("l1_log, silog=0.5") == {"l1_log": 1.0, "silog": 0.5}


@pytest.mark.parametrize("weight", ["0", "-1", "inf", "nan"])
def test_a_weight_that_does_not_weigh_is_refused(weight):
    with pytest.raises(OptionError, match=rf"weight `{weight}` of loss `l1`; expected more than 0"):
        losses.parse_loss(f"mse,l1={weight}")


def test_a_loss_named_twice_is_refused():
    with pytest.raises(OptionError, match="`--loss l1, mse, l1=2` names `l1` twice"):
        losses.parse_loss("l1, mse, l1=2")


@pytest.mark.parametrize("text", ["l3", "l1=much"])
def test_an_unknown_loss_is_refused_by_name(text):
    with pytest.raises(ConfigError, match=r"l3|much"):
        losses.parse_loss(text)


def test_a_log_network_is_compared_in_meters_where_the_loss_is_linear():
    raw = image(math.log(2.0))
    value = losses.weighted_depth_loss(raw, image(3.0), weights={"mse": 2.0}, log_network=True)
    assert value.item() == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("name", [*losses.IN_LINEAR, *losses.IN_LOG])
def test_every_loss_has_a_finite_gradient_with_holes_in_the_truth(name):
    raw = torch.zeros(2, 1, 8, 8, requires_grad=True)
    truth = torch.rand(2, 1, 8, 8) + 0.5
    truth[:, :, :3] = NAN
    losses.weighted_depth_loss(raw, truth, weights={name: 1.0}, log_network=True).backward()
    assert raw.grad.isfinite().all()
    assert raw.grad.abs().sum() > 0


@pytest.mark.parametrize("name", [*losses.IN_LINEAR, *losses.IN_LOG])
def test_a_batch_without_truth_moves_nothing(name):
    raw = torch.rand(2, 1, 8, 8, requires_grad=True)
    truth = torch.full((2, 1, 8, 8), NAN)
    loss = losses.weighted_depth_loss(raw, truth, weights={name: 1.0}, log_network=False)
    loss.backward()
    assert loss.item() == pytest.approx(0.0, abs=1e-3)  # `silog` has the root of its least value
    assert not raw.grad.any()


def test_a_batch_without_labels_moves_nothing():
    logits = torch.rand(2, 3, 4, 4, requires_grad=True)
    labels = torch.full((2, 4, 4), IGNORE)
    loss = losses.cross_entropy(logits, labels, weights=torch.ones(3), smoothing=0.05)
    loss.backward()
    assert loss.item() == 0.0 and not logits.grad.any()
