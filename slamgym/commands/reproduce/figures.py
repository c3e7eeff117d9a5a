"""The pictures of a reproduction's report, each with what it shows, and what the paper's figure of its number shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from slamgym.core.files import read_bytes
from slamgym.core.pictures import decode_picture
from slamgym.viz.pages import figure, inline_picture, paragraph

LOSSES = "runs/{network}/losses.png"
"""Where ``slamgym gan train`` has drawn the losses of a network."""
NEARNESS = "nearness.png"
"""Name of the picture of :func:`slamgym.commands.reproduce.nearness.plot_nearness`."""


class CaptionedPicture(NamedTuple):
    """Pictures below the reproduction's folder, and what stands below them."""

    pattern: str
    caption: str
    """``{name}``: the file's name without its suffix."""


PAPER_FIGURES = (
    CaptionedPicture(
        "protocol/evaluation/maps.png",
        "The paper's Figure 5 shows translations beside the CAD maps. Here, by its protocol: SLAM map, what the "
        "methods named make of it, and the CAD map with walls of 10 px.",
    ),
    CaptionedPicture(
        "protocol/evaluation/overlays.png",
        "The same maps laid over the CAD map after alignment, as the error of Table I sees them. White: free in both; "
        "red: free in the method's map only; blue: in the CAD map only.",
    ),
    CaptionedPicture(
        "protocol/evaluation/differences.png",
        "The paper's Figure 6 is a box plot of MSE2 - MSE1 of Model32 over its 21 maps: quartiles 0 and 0.080. Here "
        "the same difference of the methods named over all maps of the protocol.",
    ),
    CaptionedPicture(
        "deformed/modelprog.png",
        "The paper's Figure 7 shows SLAM maps that Modelprog draws of CAD maps. Here those of three bundled plans: "
        "CAD map, Modelprog's map, errors of its walls.",
    ),
    CaptionedPicture(
        "deformed/ekf_64.png",
        "The paper's Figure 8 shows maps of the parametric model by its conversions. Here EKF (a) at 64 x 64 px: "
        "CAD map, parametric map, errors of its walls and the path.",
    ),
    CaptionedPicture(
        "deformed/ekf_64_to_256.png",
        "For Figure 8: EKF (b), whose displacements at 64 x 64 px were enlarged to 256 x 256.",
    ),
    CaptionedPicture("deformed/two_phase.png", "For Figure 8: [26] (two_phase) at 256 x 256 px."),
    CaptionedPicture(
        "deformed/ekf_schur.png",
        "Not in the paper: this package's own conversion, ekf_schur, at 256 x 256 px.",
    ),
    CaptionedPicture(
        "evaluation/cad2slam.png",
        "The paper's Figure 9 shows the parametric map and Modelprog's beside the simulated one. Here, of the test "
        "maps: the CAD map; along the path that the robot drove the parametric map and that of this package's "
        "generator; Modelprog's of the CAD map as it is, and bent as drift would; the simulated SLAM map.",
    ),
    CaptionedPicture(
        NEARNESS,
        "Figures 7 and 9 in numbers: by how much the map of the method named lies nearer to the simulated map of the "
        "same exploration than Modelprog's does, by the aligned mean squared error.",
    ),
)
"""Figures 5 to 9."""
OTHER_FIGURES = (
    CaptionedPicture(
        "evaluation/maps.png", "With true faces: SLAM map, what each method makes of it, CAD map."
    ),
    CaptionedPicture(
        "evaluation/overlays.png",
        "With true faces: each laid over the CAD map. White: free in both; red: free in the method's map only; "
        "blue: in the CAD map only.",
    ),
    CaptionedPicture(
        "deformed/generator.png",
        "Maps that this package's generator draws of three bundled plans along planned paths.",
    ),
    CaptionedPicture(
        "deformed/elastic.png", "Three bundled plans bent by a random field, without a path."
    ),
    CaptionedPicture("drawings/**/*.png", "Drawn as vectors from the SLAM map {name}."),
)
"""What the paper doesn't show."""


def paper_figures(out: Path, networks: tuple[str, ...]) -> list[str]:
    """Figures 4 to 9 as HTML.

    Args:
        out: Folder of the reproduction.
        networks: The paper's.
    """
    return [*_losses(out, networks), *pictures(out, PAPER_FIGURES)]


def _losses(out: Path, networks: tuple[str, ...]) -> Iterator[str]:
    """Figure 4."""
    trained = []
    for network in networks:
        pattern = LOSSES.format(network=network)
        if (out / pattern).exists():
            trained.append(network)
            caption = (
                f"The paper's Figure 4 shows the losses of its two models over the epochs. Here those of {network} as "
                "this run trained it, in the size for a CPU; dashed: where the resolution changes."
            )
            yield from pictures(out, [CaptionedPicture(pattern, caption)])
        elif (out / pattern).parent.is_dir():
            trained.append(network)
            yield paragraph(f"Figure 4: {network} was trained too short to draw its losses.")
    if not trained:
        yield paragraph(
            "The paper's Figure 4 shows the losses of its two models over the epochs. This run trained none, and no "
            f"losses of the weights that come with the package ({', '.join(networks)}) were kept; --train trains both "
            "in their sizes for a CPU, and shows their losses here."
        )


def pictures(out: Path, chosen: Sequence[CaptionedPicture]) -> Iterator[str]:
    """Those of the pictures that there are, as HTML."""
    for picture in chosen:
        for path in sorted(out.glob(picture.pattern)):
            pixels = decode_picture(path, read_bytes(path))
            # Plots have a fourth channel, opacity, and are opaque.
            colours = pixels[:, :, :3] if pixels.ndim == 3 else pixels
            address = inline_picture(colours)
            caption = picture.caption.format(name=path.stem)
            yield figure(f'<img alt="" src="{address}">', caption)
