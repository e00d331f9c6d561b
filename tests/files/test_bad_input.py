"""Input at fault is refused in one or two lines that name the place, the find and the need."""

import pytest
from study_files import STUDY, changed, check_refused, csv, write_study

from pdssjax import InputError, load_study

STEP = csv(5e-5, 40)
MASS = '"effector.mass" = { value = "86 g" }'
STEP_DRIVE = '{ waveform = "step", voltage = "48.2 V" }'

# name: (text replaced in the study, its replacement, what the message must contain)
STUDIES = {
    "syntax": ("[actuator]", "[actuator", ["line 4, column 10"]),
    "format missing": ('format = "pdssjax-study/1"', "", ['"format" is missing', '"pdssjax-study/1"']),
    "format of the future": ("study/1", "study/2", ['key "format"', '"pdssjax-study/2"', '"pdssjax-study/1"']),
    "unknown key, top": ("title =", "titel =", ['"titel"', '"title"']),
    "unknown key, actuator": ("feedback =", "feedbak =", ["actuator", '"feedbak"', '"feedback"']),
    "unknown key, parameter": ("min =", "minimum =", ['"piezo.gain"', '"minimum"', '"min"']),
    "unknown key, record": ("noise =", "noize =", ['record "step"', '"noize"', '"noise"']),
    "unknown key, columns": ("{ time =", "{ tme =", ['record "step": columns', '"tme"', '"time"']),
    "unknown key, drive": ("direction =", "directon =", ['record "walk": drive', '"directon"', '"direction"']),
    "unknown piezo": ('"second-order"', '"second_order"', ['"piezo"', '"second_order"', '"second-order"']),
    "unknown friction": (
        '"simplified-lugre"',
        '"simple-lugre"',
        ['"friction"', '"simple-lugre"', '"simplified-lugre"'],
    ),
    "unlike any friction": ('"simplified-lugre"', '"x"', ['"friction"', '"x"', '"anisotropic-lugre"']),
    "unknown waveform": ('"sawtooth"', '"sawtoth"', ['record "walk": drive', '"sawtoth"', '"sawtooth"']),
    "unknown direction": ('"backward"', '"back"', ['"direction"', '"back"', "backward"]),
    "unknown state": ("feedback =", 'friction_state = "froce"\nfeedback =', ['"friction_state"', '"froce"', '"force"']),
    "unknown role": ('"validate"', '"validation"', ['record "walk"', '"role"', '"validation"', '"validate"']),
    "unknown parameter": ('"friction.f_ss"', '"friction.fss"', ["parameters", '"friction.fss"', '"friction.f_ss"']),
    "parameter of another law": (
        '"friction.sigma0"',
        '"friction.sigma0_a"',
        ["parameters", '"friction.sigma0_a"', '"friction.sigma0"'],
    ),
    "unquoted parameter": ('"piezo.gain" =', "piezo.gain =", ["piezo without quotes", '"piezo...."']),
    "parameter missing": ('"friction.sigma1" = {}', "", ['"friction.sigma1" is missing']),
    "mass missing": (MASS, "", ['"effector.mass" is missing']),
    "mass of the platform missing": ("feedback = false", "feedback = true", ['"piezo.mass" is missing']),
    "rests_under_load as a number": (
        "feedback = false",
        "rests_under_load = 1",
        ['"rests_under_load"', "found 1", "true or false"],
    ),
    "feedback as text": ("feedback = false", 'feedback = "no"', ['"feedback"', '"no"', "true or false"]),
    "negative mass": ('"86 g"', '"-86 g"', ['"effector.mass"', '"value"', "-86 g", "above 0 g"]),
    "overdamped": ('"20 %"', "1.2", ['"piezo.damping_ratio"', "1.2", "below 1"]),
    "negative fall time": ('"1 ms"', '"-1 ms"', ['"drive.fall_time"', "-1 ms", "at least 0"]),
    "fall time beyond the period": ('"1 ms"', '"0.3 s"', ['"drive.fall_time"', "0.3 s", "0.2 s", 'record "walk"']),
    "own fall time beyond the period": ('"5 Hz"', '"5 Hz", fall_time = 1', ['"fall_time"', "1 s", "0.2 s"]),
    "parameter without a table": (MASS, '"effector.mass" = "86 g"', ['"effector.mass"', '"86 g"', "a table such as"]),
    "unknown unit": ('"86 g"', '"86 grm"', ['"effector.mass"', '"grm"', "kg"]),
    "wrong dimension": ('"48.2 V"', '"48.2 mm"', ['record "step": drive', '"voltage"', '"mm"', "converts to V"]),
    "text without a unit": ('"48.2 V"', '"48.2"', ['"voltage"', "no unit", "converts to V"]),
    "not a number": ('"48.2 V"', '"high"', ['"voltage"', '"high"', "1 V"]),
    "truth value for a number": ('"48.2 V"', "true", ['"voltage"', "True", "1 V"]),
    "NaN in the study": ('"86 g"', "nan", ['"effector.mass"', "nan", "finite"]),
    "beyond all floats": ('"86 g"', "1" + "0" * 400, ['"effector.mass"', "1000", "finite"]),
    "beyond all integers": ('"86 g"', "1" + "0" * 5000, ["no valid TOML", "digits"]),
    "beyond all integers, in hexadecimal": ('"86 g"', "0x" + "f" * 5000, ["no valid TOML", "digits"]),
    "exponent beyond all": (
        '"86 g"',
        '"1e99999999999999999999 g"',
        ['"effector.mass"', "1e99999999999999999999", "finite"],
    ),
    "cycles in superscript": (
        'role = "validate"',
        'role = "validate"\nconditioning = "² cycles"',
        ['"conditioning"', "² cycles"],
    ),
    "decimated to nothing": ("noise =", "decimate = 1000000000000000000\nnoise =", ['"decimate"', "40 samples"]),
    "file of a name that none has": ('"step.csv"', '"step\\u0000.csv"', ["step", "null byte"]),
    "start below min": ('"0.1 um/V"', '"0.01 um/V"', ['"piezo.gain"', '"start"', "0.01 um/V", "0.05 um/V"]),
    "start above max": ('"0.1 um/V"', '"1 um/V"', ['"piezo.gain"', '"start"', "1 um/V", "0.2 um/V"]),
    "bounds crossed": ("2e-7", "1e-8", ['"piezo.gain"', '"min"', "0.05 um/V", "0.01 um/V"]),
    "bound outside the legal range": ("max = 2e-7", "max = -2e-7", ['"piezo.gain"', '"max"', "-2e-07", "above 0"]),
    "value and start": ('{ value = "86 g" }', "{ value = 0.086, start = 0.1 }", ['"value"', '"start"', "one or the"]),
    "step without voltage": (STEP_DRIVE, '{ waveform = "step" }', ['record "step": drive', '"voltage" is missing']),
    "step with a voltage to be guessed": (
        f"drive = {STEP_DRIVE}",
        'drive = { waveform = "step" }\n[parameters."drive.voltage"]',
        ["parameters: drive.voltage", '"value" is missing'],
    ),
    "sawtooth without voltage": ('voltage = "64.2 V", ', "", ['record "walk": drive', '"voltage" is missing', "V"]),
    "sawtooth without frequency": (', frequency = "5 Hz"', "", ['record "walk": drive', '"frequency" is missing']),
    "no volts": ('"48.2 V"', '"0 V"', ['"voltage"', "0 V", "moves the actuator"]),
    "frequency of zero": ('"5 Hz"', "0", ['"frequency"', "0 Hz", "above 0"]),
    "drive missing": (f"drive = {STEP_DRIVE}", "", ['record "step"', '"drive" is missing']),
    "waveform missing": ('waveform = "step", ', "", ['record "step": drive', '"waveform" is missing']),
    "columns missing": ("columns =", "units =", ['record "step"', '"columns" is missing']),
    "file missing in the study": ('file = "step.csv"\n', "", ['record "step"', '"file" is missing']),
    "force needs its column": (
        '"platform"',
        '"force"',
        ['record "step": columns', '"displacement"', '"time", "force"'],
    ),
    "friction has no drive": (
        '"platform"',
        '"friction"',
        ['record "step"', 'key "drive"', "found a drive", '"motion" of a friction record is prescribed'],
    ),
    "unknown measurand": ('"platform"', '"platfrom"', ['"measures"', '"platfrom"', '"platform"']),
    "two records of one name": ('name = "walk"', 'name = "step"', ['two records named "step"']),
    "unknown table": ('[[record]]\nname = "step"', '[[recrd]]\nname = "step"', ['"recrd"', '"record"']),
    "no noise at all": ('"0.01 um"', "0", ['record "step"', '"noise"', "0 m", "above 0"]),
    "offset as a word": ('"2 um"', '"fre"', ['record "walk"', '"offset"', '"fre"', "m"]),
    "window reversed": ("noise =", "window = [2, 1]\nnoise =", ['"window"', "2 s to 1 s", "after its start"]),
    "window of three": ("noise =", "window = [1, 2, 3]\nnoise =", ['"window"', "[1, 2, 3]", "a pair"]),
    "window beyond the record": ("noise =", "window = [1, 2]\nnoise =", ['record "step"', "no sample", "0.00195 s"]),
    "pair without an end": ("noise =", "exclude = [[1, 2], [3]]\nnoise =", ['"exclude": pair 2', "[3]", "a pair"]),
    "no such record file": ('"step.csv"', '"stp.csv"', ["stp.csv", "no such file"]),
    "record file is a folder": ('"step.csv"', '"."', ["cannot be read", "directory"]),
    "no such column": ('"displacement_um"', '"displacment_um"', ["step.csv", '"displacment_um"', '"displacement_um"']),
    "column of another dimension": ('displacement = "displacement_um"', 'displacement = "time_s"', ['"s"', "to m"]),
}

# name: (text of the step's CSV file, what the message must contain)
FILES = {
    "empty": ("", ["empty"]),
    "blank": ("\n \n", ["empty"]),
    "header only": ("time_s,displacement_um\n", ["no samples"]),
    "remark only": ("# nothing here\n", ["no samples"]),
    "no header": ("0,1\n1,2\n", ["line 1", "header"]),
    "word in a cell": (changed("0.000100,", "soon,", STEP), ["line 4", '"time_s"', '"soon"', "number"]),
    "NaN": (changed("0.8415", "NaN", STEP), ["line 3", '"displacement_um"', '"NaN"', "finite"]),
    "infinite": (changed("0.8415", "-inf", STEP), ["line 3", '"displacement_um"', '"-inf"', "finite"]),
    "empty cell": (changed("0.8415", "", STEP), ["line 3", '"displacement_um"', "an empty cell", "finite"]),
    "ragged": (changed("0.8415", "0.8415,7", STEP), ["line 3", "3 cells", "expected 2"]),
    "time repeats": (changed("0.000100,", "0.000050,", STEP), ["line 4", '"time_s"', "5e-05 s", "increase"]),
    "time goes back far from 0": (
        "time_s,displacement_um\n1700000000.001,1\n1700000000.002,2\n1700000000.0015,3\n",
        ["1700000000.0015 s after 1700000000.002 s"],
    ),
    "time goes back": ("# old\n" + changed("0.000100,", "0.000010,", STEP), ["line 5", "1e-05 s after 5e-05 s"]),
    "time column missing": (changed("time_s,", "displacement_um,", STEP), ['"time_s"']),
    "column named twice": (
        "time_s,displacement_um,displacement_um\n0,1,2\n",
        ['found 2 columns named "displacement_um"'],
    ),
    "never moves": ("time_s,displacement_um\n0,1\n1e-5,1\n2e-5,1\n", ['"displacement_um"', "3 samples", "moves"]),
    "a cell too many among blanks": (
        "time_s displacement_um\n0 1\n1e-5 1 234.5\n2e-5 3\n3e-5 4\n",
        ["line 3", "3 cells", "expected 2"],
    ),
    "a cell too few among blanks": (
        "time_s displacement_um u\n0 1 5\n1e-5 2 5\n2e-5   5\n3e-5 4 5\n",
        ["line 4", "2 cells", "expected 3"],
    ),
    "a quote that nothing closes": (
        'time_s,displacement_um,u\n0,1,5\n1e-5,"2,5\n2e-5,3,5\n3e-5,"4,5\n',
        ["line 3", "2 cells", "expected 3"],
    ),
    "dates": (
        "time_s,displacement_um\n2024-01-05T10:00:00.000,1\n2024-01-05T10:00:00.001,2\n",
        ["line 3", '"2024-01-05T10:00:00.001"', "times in seconds"],
    ),
    "dates beside numbers": (
        "time_s,displacement_um,u\n10:00:00.000,1,5\n10:00:00.001,2,5\n",
        ["line 2", '"time_s"', '"10:00:00.000"', "expected numbers"],
    ),
    "fewer samples than unknowns": ("time_s,displacement_um\n0,1\n1e-5,2\n", ["2 samples", "6 free", "1 offsets"]),
}


@pytest.mark.parametrize(("old", "new", "essentials"), STUDIES.values(), ids=STUDIES)
def test_study_at_fault(tmp_path, old, new, essentials):
    check_refused(write_study(tmp_path, changed(old, new)), *essentials)


@pytest.mark.parametrize(("text", "essentials"), FILES.values(), ids=FILES)
def test_file_at_fault(tmp_path, text, essentials):
    check_refused(write_study(tmp_path, step=text), *essentials)


def test_column_without_a_unit(tmp_path):
    path = write_study(tmp_path, changed('"time_s"', '"time"'), step=changed("time_s", "time", STEP))
    check_refused(path, 'column "time": found no unit, expected a column named like "time_s"')


def test_file_that_is_not_text(tmp_path):
    path = write_study(tmp_path)
    (tmp_path / "step.csv").write_bytes(b"\xff\xfe\x00t")
    check_refused(path, "step.csv")


def test_no_such_study(tmp_path):
    check_refused(tmp_path / "nothing.toml", "nothing.toml: there is no such file")


def test_study_that_is_a_folder(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_study(tmp_path)


def test_records_in_single_brackets(tmp_path):
    text = STUDY.partition('[[record]]\nname = "walk"')[0].replace("[[record]]", "[record]")
    check_refused(write_study(tmp_path, text), '"record": found a table, expected one [[record]] table')
