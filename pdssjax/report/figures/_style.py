"""Colours and style of every figure; the palette of Okabe and Ito."""

from typing import Any

# From the palette of Okabe and Ito, distinct also with a colour vision deficiency and in grey print.
GREY, VERMILION, BLUE, YELLOW, GREEN = "0.5", "#D55E00", "#0072B2", "#F0E442", "#009E73"

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "legend.frameon": False,
    "figure.dpi": 200,
}
