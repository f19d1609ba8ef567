"""Options about the depth autoencoder: its decoder in another network, and what it lacks."""

import argparse
from pathlib import Path

from nunet_models.errors import ConfigError, OptionError
from nunet_models.zoo import Component, GraphSpec
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.spec import decoder_name
from nunet_models.zoo.weights import take_decoder

_DECODER_OPTIONS = ("plug_decoder", "freeze_decoder")


def add_decoder_options(group: argparse._ArgumentGroup) -> None:
    """Add the options that say where a decoder without skip connections comes from."""
    group.add_argument(
        "--plug-decoder",
        type=Path,
        metavar="CHECKPOINT",
        help="take the decoder from the checkpoint of an autoencoder, for `wnet_c_auto`",
    )
    group.add_argument(
        "--freeze-decoder",
        action="store_true",
        help="keep that decoder as it is (default: it is trained on)",
    )


def check_autoencoder_options(options: argparse.Namespace, spec: GraphSpec) -> None:
    """Refuse what an autoencoder or a network without its decoder does not have.

    # Errors
    `OptionError` that names the option.
    """
    if spec.reads_depth:
        for name in ("sets", "show"):
            if getattr(options, name):
                raise OptionError(
                    f"`--{name}` shows images to the network; `{spec.architecture}` reads depth",
                    hint="train it on `--data`, without `--sets` and `--show`",
                )
    given = [name for name in _DECODER_OPTIONS if getattr(options, name)]
    if not given:
        return
    if spec.reads_depth or not spec.component(options.component).latent:
        raise OptionError(
            f"`--{given[0].replace('_', '-')}`: `{options.component}` of `{spec.architecture}` "
            "cannot take the decoder of an autoencoder",
            hint="`--architecture wnet_c_auto --component depth` can",
        )


def plug_decoder(
    component: Component,
    spec: GraphSpec,
    options: argparse.Namespace,
    *,
    decoder: Checkpoint | None,
    is_trained: bool,
) -> None:
    """Take and freeze the decoder, as the options say.

    `decoder` is the checkpoint of `--plug-decoder`, and `is_trained` says whether the component has
    the weights of a training already.

    # Errors
    `ConfigError` for the checkpoint of a network whose decoder does not fit or was not trained,
    `OptionError` if random weights would be frozen.
    """
    if decoder is not None:
        last = decoder.spec.components[-1]
        mine = _decoder(component.spec.latent, component.spec.decoder_channels, spec.encoding)
        its = _decoder(last.latent, last.decoder_channels, decoder.spec.encoding)
        if mine != its:
            raise ConfigError(
                f"`--plug-decoder {options.plug_decoder}` has {its}; expected {mine}",
                hint="an autoencoder that was trained with the same `--decoder` and `--encoding`",
            )
        if not decoder.history.get(last.name):
            raise ConfigError(
                f"`--plug-decoder {options.plug_decoder}`: its `{last.name}` was not trained",
                hint="`train --architecture autoencoder --component depth` trains a decoder",
            )
        take_decoder(component, decoder.component_weights(last.name))
    if options.freeze_decoder:
        if decoder is None and not is_trained:
            raise OptionError(
                "`--freeze-decoder` would keep random weights",
                hint="`--plug-decoder CHECKPOINT` takes trained ones",
            )
        component.freeze_decoder()


def _decoder(latent: int, channels: tuple[int, ...], encoding: str) -> str:
    """A decoder in words."""
    read = f"{latent} latent channels" if latent else "skip connections"
    return f"a decoder `{decoder_name(channels)}` of {read} for {encoding} depth"
