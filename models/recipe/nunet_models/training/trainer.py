"""Training of what an objective names: one component of a serial graph, or its confidence head."""

import copy
import time
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from nunet_models.data.batches import Batch
from nunet_models.data.cache import REACH_M
from nunet_models.errors import ConfigError
from nunet_models.training.depthwise import use_fast_kernels
from nunet_models.training.ema import Averaged
from nunet_models.training.feed import Feed
from nunet_models.training.log import RunLog
from nunet_models.training.objective import objective
from nunet_models.training.same_run import graph_differences, provenance_differences
from nunet_models.training.schedule import learning_rate_factor
from nunet_models.training.settings import Settings
from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.checkpoint import Checkpoint

SAVE_EVERY_S = 480.0  # a crash loses at most this much work
LOG_EVERY = 20  # steps of which a row of the log is the mean; an epoch's last row may have fewer
OPTIMIZERS = {"adamw": torch.optim.AdamW, "adam": torch.optim.Adam}


class Trainer:
    """Trains the component of `graph` that `settings` name.

    `LAST` in the run's folder holds what `resume` needs, `BEST` the averaged weights of the best
    epoch. `before` is the checkpoint that the graph came from: its history is carried on, and
    its provenance, which says where this run comes from too.
    """

    LAST = "last.pt"
    BEST = "best.pt"

    def __init__(
        self,
        graph: SerialGraph,
        settings: Settings,
        *,
        feed: Feed,
        folder: Path,
        before: Checkpoint | None = None,
    ) -> None:
        self.graph, self.settings, self.feed, self.folder = graph, settings, feed, folder
        self.component = graph.component(settings.component)
        self.objective = objective(graph, settings)
        self._check_truth()
        self._check_label_loss()
        torch.manual_seed(settings.seed)
        torch.set_num_threads(settings.threads)
        graph.to(memory_format=torch.channels_last)
        self.frozen, self.trained = self.objective.frozen, self.objective.trained
        for component in self.frozen:
            component.freeze()
        for component in self.trained:
            component.train()
            if settings.compile and settings.bf16:
                use_fast_kernels(component)
        self.averages = [Averaged(component, settings.ema) for component in self.trained]
        self.optimizer = _optimizer(self.trained, settings)
        self.objective.weigh_classes(feed)
        self.step, self.epoch, self.batch = 0, 0, 0
        self.losses: list[float] = []
        self.history: list[dict[str, float]] = []
        self.before = before or Checkpoint(graph.spec, {})

    def _check_truth(self) -> None:
        needs = self.objective.needs
        for name, there in self.feed.has(needs).items():
            if needs == "labels" and not there:
                raise ConfigError(
                    f"the {name} data has no labels",
                    hint="it needs a folder `labels` (classes "
                    "from 0 to 12) or `label40` (from 0 to 39)",
                )
            if not there:
                raise ConfigError(
                    f"the {name} data has no depth",
                    hint=f"every pixel of `depth` is 0, outside of "
                    f"`--window`, or beyond {REACH_M:.1f} m by `--depth-scale`",
                )

    def _check_label_loss(self) -> None:
        require_segmentation(self.graph.spec, self.settings)
        if self.settings.label_loss and not self.feed.has("labels")["training"]:
            raise ConfigError("`--label-loss`: the training data has no labels")

    @property
    def batches(self) -> int:
        """Optimizer's steps of an epoch."""
        return self.feed.images() // self.settings.batch

    def run(self, *, minutes: float | None, quiet: bool) -> bool:
        """Train until the last epoch or until `minutes` have passed; True when all is done."""
        start = time.monotonic()
        deadline = start + minutes * 60.0 if minutes else float("inf")
        log = RunLog(self.folder)
        forward = self._forward_functions()
        try:
            while self.epoch < self.settings.epochs:
                if not self._train_epoch(forward, log, deadline, quiet):
                    return False
                self._finish_epoch(log, quiet)
        finally:
            log.close()
        return True

    def _forward_functions(self) -> tuple[list, list]:
        if not self.settings.compile:
            return self.frozen, self.trained
        return [torch.compile(c) for c in self.frozen], [torch.compile(c) for c in self.trained]

    def _train_epoch(self, forward: tuple, log: RunLog, deadline: float, quiet: bool) -> bool:
        saved = time.monotonic()
        progress = tqdm(
            self.feed.epoch(self.graph, self.settings, self.epoch, self.batch),
            total=self.batches,
            initial=self.batch,
            desc=f"{self.settings.component} {self.epoch + 1}/{self.settings.epochs}",
            disable=quiet,
        )
        for batch in progress:
            self.losses.append(self._step(batch, forward))
            self.batch += 1
            if self.step % LOG_EVERY == 0:
                progress.set_postfix(loss=f"{np.mean(self.losses):.4f}")
                self._log_losses(log)
            now = time.monotonic()
            if now > deadline or now - saved > SAVE_EVERY_S:
                self.save()
                saved = now
            if now > deadline:
                return False
        self._log_losses(log)
        return True

    def _log_losses(self, log: RunLog) -> None:
        """Log the mean loss of the steps since the last time, if there were any."""
        if self.losses:
            rate = self.optimizer.param_groups[-1]["lr"]
            log.step(self.step, {"loss": float(np.mean(self.losses)), "lr": rate})
        self.losses = []

    def _step(self, batch: Batch, forward: tuple) -> float:
        settings = self.settings
        factor = learning_rate_factor(
            self.step,
            steps=settings.epochs * self.batches,
            warmup=settings.warmup,
            final=settings.final_lr,
            schedule=settings.schedule,
        )
        for group in self.optimizer.param_groups:
            group["lr"] = group["base_lr"] * factor
        loss = self.objective.loss(batch, *forward)
        value = loss.item()
        if not np.isfinite(value):  # before it reaches the weights
            raise ConfigError(
                f"the loss is {value} at step {self.step + 1}",
                hint="lower `--lr` in another `--run`",
            )
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        if settings.clip:
            parameters = [p for component in self.trained for p in component.parameters()]
            nn.utils.clip_grad_norm_(parameters, settings.clip)
        self.optimizer.step()
        self.step += 1
        for averaged in self.averages:
            averaged.update(self.step)
        return value

    def _finish_epoch(self, log: RunLog, quiet: bool) -> None:
        self.epoch, self.batch = self.epoch + 1, 0
        if self.epoch % self.settings.validate_every and self.epoch < self.settings.epochs:
            self.save()
            return
        graph = self.averaged_graph()
        index = self.objective.index
        metrics = self.feed.validate(graph, index, self.settings)
        log.prediction(self.epoch, self.feed.shown(graph, index, self.settings))
        log.epoch(self.epoch, metrics)
        if not quiet:
            shown = " ".join(f"{name} {value:.4f}" for name, value in metrics.items())
            tqdm.write(f"epoch {self.epoch}: {shown}")
        self.history.append({"epoch": self.epoch, **metrics})
        score = [self.objective.score(row, self.feed) for row in self.history]
        if score[-1] == max(score):
            self.save(best=True)  # first: a run that ends in between repeats the epoch from `LAST`
        self.save()

    def averaged_graph(self) -> SerialGraph:
        """A copy of the graph with the averaged weights of the components in training."""
        graph = copy.deepcopy(self.graph)  # a fresh one would draw from the run's random numbers
        trained = objective(graph, self.settings).trained
        for component, averaged in zip(trained, self.averages, strict=True):
            component.load_state_dict(averaged.module.state_dict())
        return graph.eval()

    def save(self, *, best: bool = False) -> None:
        """Write `LAST`, or `BEST` (which carries no optimizer and cannot be resumed)."""
        name = self.settings.component
        progress = {
            "component": self.component.state_dict(),
            "unfrozen": [component.state_dict() for component in self.trained[:-1]],
            "optimiser": self.optimizer.state_dict(),
            "torch_rng": torch.get_rng_state(),
            "step": self.step,
            "epoch": self.epoch,
            "batch": self.batch,
            "losses": self.losses,
            "trains": name,
        }
        Checkpoint(
            self.graph.spec,
            self.averaged_graph().state_dict(),
            None if best else progress,
            {**self.before.history, name: self.history},
            {**self.before.settings, name: self.settings.to_json()},
            self.before.provenance,
        ).save(self.folder / (self.BEST if best else self.LAST))

    def resume(self) -> None:
        """Continue from `LAST`, with the same losses as an uninterrupted run.

        # Errors
        `ConfigError` when the run in the folder is of another graph or another component, or was
        started with other settings, other data or from other weights.
        """
        checkpoint = Checkpoint.load(self.folder / self.LAST)
        progress, name = checkpoint.progress, self.settings.component
        if progress is None:
            raise ConfigError(f"`{self.folder / self.LAST}` holds no training to resume")
        self._check_same_run(checkpoint, progress)
        self.graph.load_state_dict(checkpoint.weights)
        live = [*progress.get("unfrozen", []), progress["component"]]
        for component, averaged, weights in zip(self.trained, self.averages, live, strict=True):
            averaged.module.load_state_dict(component.state_dict())
            component.load_weights(weights)
        self.optimizer.load_state_dict(progress["optimiser"])
        torch.set_rng_state(progress["torch_rng"])
        self.step, self.epoch, self.batch = (progress[k] for k in ("step", "epoch", "batch"))
        self.losses = list(progress.get("losses", []))  # absent in files of earlier versions
        self.history = checkpoint.history[name]
        stated = self.before.provenance.get(name, {}).get("license")
        if stated:
            checkpoint.provenance[name]["license"] = stated
        self.before = checkpoint

    def _check_same_run(self, started: Checkpoint, progress: dict[str, Any]) -> None:
        """Refuse options that the run in the folder was not started with."""
        name, spec = self.settings.component, self.graph.spec
        known = name in started.settings and progress.get("trains", name) == name
        other = graph_differences(started.spec, spec, name) if known else []
        same_architecture = started.spec.architecture == spec.architecture
        if not (known and same_architecture and (other or started.spec == spec)):
            raise ConfigError(
                f"the run in `{self.folder}` trains another graph or component than `{name}` of "
                f"`{spec.architecture}`",
                hint="the options it was started with",
            )
        other += self.settings.differences(started.settings[name])
        other += provenance_differences(
            started.provenance.get(name, {}), self.before.provenance.get(name, {})
        )
        if other:
            raise ConfigError(
                f"the run in `{self.folder}` was started with {'; '.join(other)}",
                hint="the options it was started with, or another `--run` with "
                f"`--start {self.folder / self.BEST}`",
            )


def require_segmentation(spec: GraphSpec, settings: Settings) -> None:
    """Refuse a loss of labels where no earlier component segments.

    # Errors
    `ConfigError` that names the component.
    """
    if not settings.label_loss:
        return
    index = spec.components.index(spec.component(settings.component))
    if not any(component.task == "segmentation" for component in spec.components[:index]):
        raise ConfigError(
            f"`--label-loss`: no component before `{settings.component}` segments",
            hint="leave the option out",
        )


def _optimizer(components: list[nn.Module], settings: Settings) -> torch.optim.Optimizer:
    """Weight decay on convolutions alone; encoders at their own rate."""
    groups: dict[tuple[bool, bool], list[nn.Parameter]] = {}
    for name, parameter in chain.from_iterable(c.named_parameters() for c in components):
        if not parameter.requires_grad:  # of a frozen decoder
            continue
        encoder = name.startswith("unet.encoder")
        groups.setdefault((encoder, parameter.dim() > 1), []).append(parameter)
    listed = [
        {
            "params": parameters,
            "lr": settings.lr * (settings.encoder_lr if encoder else 1.0),
            "base_lr": settings.lr * (settings.encoder_lr if encoder else 1.0),
            "weight_decay": settings.weight_decay if decays else 0.0,
        }
        for (encoder, decays), parameters in groups.items()
    ]
    return OPTIMIZERS[settings.optimizer](listed, fused=True)  # one pass over the weights
