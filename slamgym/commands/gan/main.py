"""The commands of ``slamgym gan``: torch and scikit-learn are imported after the arguments are parsed."""

import tyro

from slamgym.commands.extras import Extra, require
from slamgym.commands.gan.arguments import (
    EvaluateTranslatorsArguments,
    PublishArguments,
    TrainTranslatorArguments,
    TranslateArguments,
)
from slamgym.core.progress import tell


def train_command(argv: list[str]) -> int:
    """``slamgym gan train``; returns the exit code."""
    arguments = tyro.cli(TrainTranslatorArguments, args=argv, prog="slamgym gan train")
    from slamgym.commands.gan.train import run_training

    return run_training(arguments, argv)


def translate_command(argv: list[str]) -> int:
    """``slamgym gan translate``; returns the exit code."""
    arguments = tyro.cli(TranslateArguments, args=argv, prog="slamgym gan translate")
    from slamgym.commands.gan.translate import run_translation

    return run_translation(arguments)


def evaluate_command(argv: list[str]) -> int:
    """``slamgym gan evaluate``; returns the exit code."""
    arguments = tyro.cli(EvaluateTranslatorsArguments, args=argv, prog="slamgym gan evaluate")
    require(Extra("gan", ("sklearn", "matplotlib")), "slamgym gan evaluate")
    from slamgym.commands.gan.evaluate import run_evaluation

    return run_evaluation(arguments)


def publish_command(argv: list[str]) -> int:
    """``slamgym gan publish``; returns the exit code."""
    arguments = tyro.cli(PublishArguments, args=argv, prog="slamgym gan publish")
    from slamgym.gan.weights import PRETRAINED_FOLDER, publish

    folder = arguments.out or PRETRAINED_FOLDER
    path = publish(arguments.run, arguments.name, arguments.data, arguments.command, folder)
    tell(f"{path}")
    return 0
