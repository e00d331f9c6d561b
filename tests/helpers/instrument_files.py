"""The same samples as instruments write them, each file made by the library of its format where there is one."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

COUNT = 600
INTERVAL = 5e-5
START = -2e-3
TIME = START + INTERVAL * np.arange(COUNT)
VOLTAGE = np.round(np.where(TIME < 0, 0.0, 48.2), 4)
MOTION = np.round(4.8 - 6.0 * np.exp(-900.0 * np.maximum(TIME, 0.0)) * np.cos(6600.0 * TIME), 4)
"""[um]"""
ROWS = list(zip(TIME, VOLTAGE, MOTION, strict=True))


def rows(separator: str, decimal: str = ".", end: str = "\n", tail: str = "") -> str:
    """The samples as text."""
    lines = [separator.join(f"{value:.6f}" for value in row) + tail for row in ROWS]
    return end.join(lines).replace(".", decimal) + end


def _text(head: str, body: str, encoding: str = "utf-8") -> Callable[[Path], None]:
    return lambda file: file.write_bytes((head + body).encode(encoding))


def _tek(file: Path) -> None:
    """A Tektronix TDS: the preamble stands beside the first samples, voltages in one file."""
    beside = ["Record Length,600", "Sample Interval,5e-05", "Trigger Point,40", "", "Source,CH1", "Vertical Units,V"]
    beside += ["Vertical Scale,20.0", "Horizontal Units,s"]
    lines = [
        f"{beside[k] if k < len(beside) and beside[k] else ','},,{t:.6f},{m:.4f}," for k, (t, _, m) in enumerate(ROWS)
    ]
    file.write_text("\r\n".join(lines) + "\r\n")


def _rigol(file: Path) -> None:
    head = f"X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,{START:e},{INTERVAL:e}\n"
    file.write_text(head + "".join(f"{k},{u:.4f},{m:.4f},,\n" for k, (_, u, m) in enumerate(ROWS)))


TEXTS: dict[str, Callable[[Path], None]] = {
    "comma": _text("time_s,voltage_V,displacement_um\n", rows(",")),
    "semicolon and decimal comma": _text("Zeit_s;Spannung_V;Weg_um\r\n", rows(";", ",", "\r\n")),
    "Excel in Europe": _text("Zeit;Spannung;Weg\r\ns;V;µm\r\n", rows(";", ",", "\r\n"), "cp1252"),
    "Excel, UTF-16 text": _text("Time [s]\tVoltage [V]\tPosition [µm]\r\n", rows("\t", ",", "\r\n"), "utf-16"),
    "BOM": _text("time_s,voltage_V,displacement_um\n", rows(","), "utf-8-sig"),
    "tab": _text("t (s)\tu (V)\tx (um)\n", rows("\t")),
    "blanks": _text("# time_s voltage_V displacement_um\n", rows(" ")),
    "LabVIEW": _text(
        "LabVIEW Measurement\nWriter_Version\t2\nSeparator\tTab\nDate\t2026/07/01\n***End_of_Header***\n\n"
        "Channels\t2\nSamples\t600\t600\nY_Unit_Label\tV\tum\n***End_of_Header***\nX_Value\tVoltage\tPosition\tComment\n",
        rows("\t", tail="\t"),
    ),
    "preamble": _text("Rig: left, 14.07.2026\nOperator;K. M.\nSensor range;100\n\nTime / s;U / V;x / um\n", rows(";")),
    "quoted": _text('"time_s","voltage_V","displacement_um"\n', '"' + rows('","', ",", '"\n"')[:-1]),
    "trailing separator": _text("time_s;voltage_V;displacement_um;\n", rows(";", tail=";")),
    "PicoScope": _text("Time,Channel A,Channel B\n(s),(V),(um)\n\n", rows(",")),
    "Keysight": _text("x-axis,1,2\nsecond,Volt,um\n", rows(",")),
    "Tektronix MSO": _text(
        "Model,MSO54\nFirmware,1.28\n\nWaveform Type,ANALOG\nHorizontal Units,s\nSample Interval,5e-05\n"
        "Record Length,600\nVertical Units,V,V\n\nTIME,CH1,CH2\n",
        rows(","),
    ),
    "LeCroy": _text(
        "LECROYWR104Xs,12345,Waveform\nSegments,1,SegmentSize,600\nSegment,TrigTime,TimeSinceSegment1\n"
        "#1,14-Jul-2026 10:00:00,0\nTime,Ampl,Ampl2\n",
        rows(","),
    ),
    "Siglent": _text(
        "Record Length,Analog:600\nSample Interval,Analog:0.00005\nVertical Units,CH1:V,CH2:V\n"
        "Horizontal Units,s\nSource,CH1,CH2\nSecond,Volt,Volt\n",
        rows(","),
    ),
    "R&S": _text("in s,C1 in V,C2 in V\n", rows(",")),
    "no header": _text("", rows(",")),
    "no header, decimal comma": _text("", rows(";", ",")),
}
"""By dialect; time, voltage and displacement are the first three columns of numbers."""
SCOPES: dict[str, Callable[[Path], None]] = {"Tektronix TDS": _tek, "Rigol": _rigol}


def _mat(version: str) -> Callable[[Path], None]:
    def write(file: Path) -> None:
        import scipy.io

        scipy.io.savemat(file, {"t": TIME, "u": VOLTAGE[:, None], "x": MOTION[None, :], "note": "July"}, format=version)

    return write


def mat_structs(file: Path) -> None:
    """A MATLAB struct, and dSPACE's layout."""
    import scipy.io

    series = [("U", VOLTAGE, "V"), ("x", MOTION, "um")]
    kinds = [("Name", object), ("Data", object), ("Unit", object)]
    ys = np.array(series, dtype=kinds)
    scipy.io.savemat(file, {"run": {"X": {"Name": "t", "Data": TIME, "Unit": "s"}, "Y": ys}, "date": "today"})


def mat73(file: Path) -> None:
    """As MATLAB writes -v7.3: HDF5 behind 512 bytes, vectors as rows, text as numbers."""
    import h5py

    with h5py.File(file, "w", userblock_size=512) as made:
        for name, values in (("t", TIME), ("u", VOLTAGE), ("x", MOTION)):
            made.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        text = made.create_dataset("note", data=np.array([[74, 117, 108, 121]], np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with file.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def hdf5(file: Path) -> None:
    import h5py

    with h5py.File(file, "w") as made:
        for name, values, unit in (("t", TIME, "s"), ("u", VOLTAGE, "V"), ("x", MOTION, "um")):
            made.create_dataset(f"run/{name}", data=values).attrs["units"] = unit


def tdms(file: Path) -> None:
    import nptdms

    clock = {"wf_increment": INTERVAL, "wf_start_offset": START}
    channels = [
        nptdms.ChannelObject("run", name, values, {"unit_string": unit, **clock})
        for name, values, unit in (("t", TIME, "s"), ("u", VOLTAGE, "V"), ("x", MOTION, "um"))
    ]
    with nptdms.TdmsWriter(file) as made:
        made.write_segment(channels)


FORMATS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "MATLAB 4": (".mat", _mat("4")),
    "MATLAB 5": (".mat", _mat("5")),
    "MATLAB struct": (".mat", mat_structs),
    "MATLAB 7.3": (".mat", mat73),
    "HDF5": (".h5", hdf5),
    "TDMS": (".tdms", tdms),
}
"""By format, its ending and what writes it; t, u and x are all its channels."""


def isf(file: Path) -> None:
    """A Tektronix ISF file of the voltage: a text of settings, then the curve as big-endian integers."""
    step = 48.2 / 30000
    curve = np.round(VOLTAGE / step).astype(">i2").tobytes()
    settings = {
        **{"BYT_NR": "2", "BIT_NR": "16", "ENCDG": "BIN", "BN_FMT": "RI", "BYT_OR": "MSB", "NR_PT": str(COUNT)},
        **{"WFID": '"Ch1, DC coupling, 2.0E1 V/div, 5.0E-3 s/div, 600 points, Sample mode"', "PT_FMT": "Y"},
        **{"XINCR": f"{INTERVAL:E}", "PT_OFF": "0", "XZERO": f"{START:E}", "XUNIT": '"s"'},
        **{"YMULT": f"{step:.9E}", "YZERO": "0.0E0", "YOFF": "0.0E0", "YUNIT": '"V"'},
    }
    head = ":WFMPRE:" + ";".join(f"{key} {value}" for key, value in settings.items())
    length = str(len(curve))
    file.write_bytes(f"{head};:CURVE #{len(length)}{length}".encode() + curve)


def broken_tdms() -> bytes:
    """A TDMS file that ends within its first segment."""
    return b"TDSm" + struct.pack("<IIQQ", 14, 4713, 100, 50) + b"\x01\0\0\0"
