"""The measured record of Liu et al. with any friction law, as a study."""

import re
import warnings
from pathlib import Path

import pdssjax
from pdssjax import InputWarning, Study
from pdssjax.core import member, members, quantities

FOLDER = Path(__file__).parents[2] / "experiments" / "liu2015"
LAWS = {law: dict.fromkeys(quantities(member("friction", law)), "") for law in members("friction")} | {
    "coulomb": {"f_c": ""},
    "simplified-lugre": {"sigma0": "", "sigma1": 'value = "100 N s/m"', "f_ss": ""},
    "stribeck": {"f_c": "", "f_s": "", "v_s": 'value = "1 mm/s"'},
    "dahl": {"sigma0": "", "f_c": "", "exponent": "value = 1"},
    "lugre": dict.fromkeys(("sigma0", "sigma1", "f_c", "f_s", "v_s"), ""),
}
"""Every law's parameters; free where nothing is said."""


def liu(law: str, folder: Path, gain: str = "0.096 um/V") -> Study:
    """The study of experiments/liu2015 with another friction law and start of the gain, written to a `folder`."""
    text = (FOLDER / "study.toml").read_text(encoding="utf-8")
    listed = "\n".join(f'"friction.{name}" = {{ {given} }}' for name, given in LAWS[law].items())
    text = re.sub(r'"friction\..*\n', "", text)
    text = text.replace("[parameters]", f"[parameters]\n{listed}").replace('"simplified-lugre"', f'"{law}"')
    text = text.replace("0.096 um/V", gain)
    text = re.sub(r'file = "(.*)"', lambda found: f'file = "{(FOLDER / found[1]).as_posix()}"', text)
    (folder / "study.toml").write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # the second record is shorter than a period
        return pdssjax.load_study(folder / "study.toml")
