"""The page in a real browser: open, turn, type, fit, cancel, save, click a point; nothing fails, nothing leaves."""

import re

import pytest
import watched_explore
from browser import DEEP, FOREIGN, PATIENCE, SELDOM, opened_page, said, served, show_tab, shows, visible_plots
from walking_study import write_made_estimate, write_made_sweep, write_walking

from pdssjax import load_study

pytestmark = pytest.mark.slow  # by default `test_page_parts` presses the buttons, and `test_server` refuses strangers


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study with its records, an estimate and a sweep."""
    place = tmp_path_factory.mktemp("rig")
    write_walking(place)
    write_made_estimate(place / "study.toml", place / "results")
    write_made_sweep(place / "map")
    return place


@pytest.fixture(scope="module")
def address(folder):
    program = (watched_explore.__file__,)
    with served(folder, "study.toml", "--estimate", "results/estimate.json", "--sweep", "map", program=program) as told:
        yield told


@pytest.fixture(scope="module")
def opened(address):
    with opened_page(address) as found:
        yield found


@pytest.fixture
def page(opened):
    return opened[0]


def chi2(page) -> float:
    """What the headline says."""
    return float(page.locator(".headline b").inner_text())


def field(page, name):
    return page.locator(f".field-{name} input")


def handle(page, name):
    return page.locator(f".slider-{name} .noUi-handle")


def redrawn(page, act) -> tuple[float, float]:
    """Chi-square before and after something that changes it."""
    before = chi2(page)
    act()
    page.wait_for_function(
        "(before) => {" + DEEP + "const b = deep('.headline').shadowRoot.querySelector('b');"
        "return b && Number(b.textContent) !== before; }",
        arg=before,
        timeout=PATIENCE,
        polling=SELDOM,
    )
    return before, chi2(page)


def test_it_opens_at_the_estimate_and_fits_the_screen(page):
    assert "Walking rig" in page.title()
    assert page.locator(".record select").input_value() == "walk"
    assert field(page, "piezo-gain").input_value() == "0.1"
    size = page.evaluate("[document.scrollingElement.scrollWidth, document.scrollingElement.scrollHeight]")
    assert size[0] <= 1366
    assert size[1] <= 768
    for name in ("fit", "cancel", "save", "record"):
        box = page.locator(f".{name}").first.bounding_box()
        assert box["y"] + box["height"] <= 768
        assert box["x"] + box["width"] <= 1366


def test_a_slider_is_dragged(page):
    grip = handle(page, "friction-f-ss")
    grip.scroll_into_view_if_needed()
    box = grip.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag():
        page.mouse.move(x, y)
        page.mouse.down()
        for step in range(1, 9):
            page.mouse.move(x + 3 * step, y)
        page.mouse.up()

    before, after = redrawn(page, drag)
    assert before != after
    assert float(field(page, "friction-f-ss").input_value()) > 0.65


def test_an_exact_number_is_typed_with_or_without_its_unit(page):
    mass = field(page, "effector-mass")

    def type_it(text):
        mass.fill(text)
        mass.press("Enter")

    redrawn(page, lambda: type_it("95.5"))
    redrawn(page, lambda: type_it("0.09 kg"))
    shows(mass, "90")
    for nonsense in ("1e308", "heavy"):
        type_it(nonsense)
        said(page, "said", "effector.mass: found .*, expected")
    said(page, "said", "heavy")
    # Waited for to its end: a redrawing on its way would be taken for that of the next test.
    redrawn(page, lambda: type_it("86"))
    page.locator(".said", has_text="heavy").wait_for(state="detached", timeout=PATIENCE)


def test_sliders_and_their_fields_are_reached_and_turned_by_keyboard(page):
    grip = handle(page, "drive-voltage")
    grip.focus()
    turned = field(page, "drive-voltage")
    before = turned.input_value()
    redrawn(page, lambda: page.keyboard.press("ArrowRight"))
    shows(turned, re.compile(f"^(?!{re.escape(before)}$)"))
    assert float(turned.input_value()) > float(before)
    page.keyboard.press("Tab")
    focused = (
        "() => {let e = document.activeElement; while (e.shadowRoot?.activeElement) e = e.shadowRoot.activeElement;"
    )
    assert page.evaluate(focused + "return e.value; }") == field(page, "drive-voltage").input_value()
    page.keyboard.press("Tab")
    assert "noUi-handle" in page.evaluate(focused + "return e.className; }")


def test_another_direction_is_chosen(page):
    redrawn(page, lambda: page.locator(".choice-direction select").select_option(label="backward"))
    redrawn(page, lambda: page.locator(".choice-direction select").select_option(label="forward"))


def test_another_record_and_every_record_is_judged(page):
    redrawn(page, lambda: page.locator(".record select").select_option("step"))
    said(page, "scores", r"step.*walk.*\(seen\)")
    assert "…" not in page.locator(".scores table").inner_text()


def test_the_stretch_enlarged_is_moved_by_buttons(page):
    for name in ("closer", "wider", "cycle ▶", "◀ cycle"):
        page.get_by_role("button", name=name).click()
    said(page, "headline", "redrawn in")


def test_the_contact_and_the_estimate_have_tabs(page):
    page.locator(".record select").select_option("walk")
    show_tab(page, "Contact and phase")
    said(page, "bk-tab.bk-active", "Contact and phase")
    show_tab(page, "Estimate")
    said(page, "estimate", r"95 % interval.*piezo\.natural_frequency")
    page.locator(".estimate table").wait_for(state="visible")
    # Plots of the correlations and of every profile, which do not make the page wider than the screen.
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 1366
    boxes = visible_plots(page, "estimate-plots")
    assert len(boxes) >= 4
    assert all(box["x"] + box["width"] <= 1366 for box in boxes)


def test_a_point_of_the_map_is_clicked_and_walks(page):
    show_tab(page, "Sweep")
    said(page, "point-told", "point 6: drive.voltage: 60 V, drive.frequency: 10 Hz")
    page.wait_for_timeout(300)
    box = page.locator(".map canvas").first.bounding_box()
    page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.25 * box["height"])
    said(page, "point-told", r"point [0-5]: drive.voltage: (30|45) V")
    number = page.locator(".map-point input")
    number.fill("11")
    number.press("Enter")
    said(page, "point-told", "point 11: drive.voltage: 75 V, drive.frequency: 40 Hz")
    number.fill("-5")
    number.press("Enter")
    said(page, "point-told", "point 0: drive.voltage: 30 V, drive.frequency: 10 Hz")
    number.fill("99")
    number.press("Enter")
    said(page, "point-told", "point 11:")
    shows(number, "11")


def test_a_fit_is_cancelled_and_the_page_goes_on(page):
    show_tab(page, "Record")
    page.locator(".fit button").click()
    page.locator(".cancel button").click()
    said(page, "fit-said", "cancelled")
    assert page.locator(".fit button").is_enabled()


def test_a_fit_from_here_moves_the_sliders_to_the_estimate(page):
    gain = field(page, "piezo-gain")
    gain.fill("0.095")
    gain.press("Enter")
    page.locator(".fit button").click()
    redrawn(page, lambda: handle(page, "effector-mass").press("ArrowRight"))  # while it fits
    said(page, "fit-said", "The fit converged")
    assert float(gain.input_value()) == pytest.approx(0.11, rel=2e-3)
    assert float(field(page, "piezo-natural-frequency").input_value()) == pytest.approx(6000.0, rel=2e-3)
    show_tab(page, "Estimate")
    # The walk, which is not fitted, is made up: no estimate from the step predicts it.
    said(page, "estimate", "Walking rig: joint fit, CONVERGED, BUT DOES NOT EXPLAIN ITS RECORDS")


def test_the_numbers_are_saved_as_a_study_and_over_nothing_unasked(page, folder):
    gain = field(page, "piezo-gain")
    gain.fill("0.11")
    gain.press("Enter")
    path = page.locator(".save-path input")
    suggested = path.input_value()
    (folder / "tool.toml").write_text("[tool]")
    page.locator(".save-replace input").check()
    for name, why in {"a\0b.toml": "expected a name", "tool.toml": "found a file that is no study"}.items():
        path.evaluate("(e, name) => { e.value = name; e.dispatchEvent(new Event('change')); }", name)
        page.locator(".save button").click()
        said(page, "save-said", f"Not saved: .*{why}")
    page.locator(".save-replace input").uncheck()
    path.fill(suggested)
    path.press("Enter")
    page.locator(".save button").click()
    said(page, "save-said", "Saved: .*study-explored.toml")
    saved = load_study(folder / "study-explored.toml")
    assert saved.parameters["piezo.gain"].start == pytest.approx(1.1e-7, rel=2e-3)
    assert saved.parameters["piezo.gain"].free
    assert not saved.parameters["effector.mass"].free
    page.locator(".save button").click()
    said(page, "save-said", "Not saved: .*found a file there already")
    page.locator(".save-replace input").check()
    page.locator(".save button").click()
    said(page, "save-said", "Saved: ")


def test_it_starts_anew_where_it_began(page):
    page.locator(".reset button").click()
    page.wait_for_function(
        "() => {" + DEEP + "return deep('.field-piezo-gain').shadowRoot.querySelector('input').value === '0.1'; }",
        timeout=PATIENCE,
        polling=SELDOM,
    )


def test_a_page_is_closed_while_it_computes_and_the_others_go_on(page, address):
    """What fails is seen at the end: `served` looks through all that the command has told."""
    other = page.context.browser.new_page()
    other.goto(address, timeout=PATIENCE)
    other.locator(".fit button").click(timeout=PATIENCE)
    show_tab(other, "Sweep")
    other.locator(".make-map button").click()
    other.close()
    show_tab(page, "Record")
    redrawn(page, lambda: handle(page, "effector-mass").press("ArrowRight"))
    redrawn(page, lambda: handle(page, "effector-mass").press("ArrowLeft"))


def test_nothing_failed_in_the_browser_and_nothing_left_this_machine(opened):
    _, errors, hosts = opened
    assert errors == []
    assert hosts <= {"127.0.0.1", "within the page"}
    assert "127.0.0.1" in hosts


def test_no_change_of_a_plot_overtook_the_plot(opened, folder):
    log = folder / watched_explore.LOG
    assert not log.exists(), log.read_text()


def test_a_page_of_another_name_for_this_machine_is_refused(page, address):
    """DNS rebinding: the name of a foreign site that resolves to 127.0.0.1, even with the secret of the address."""
    foreign = page.context.browser.new_page()
    sockets = []
    foreign.on("websocket", lambda socket: sockets.append(socket.url))
    answer = foreign.goto(address.replace("127.0.0.1", FOREIGN), timeout=PATIENCE)
    assert answer.status == 403
    assert foreign.inner_text("body").startswith("Refused.")
    assert sockets == []
    foreign.close()


def test_a_page_of_a_foreign_site_can_neither_read_nor_talk(page, address):
    foreign = page.context.browser.new_page()
    foreign.route("http://other.example/", lambda route: route.fulfill(body="<p>foreign</p>", content_type="text/html"))
    foreign.goto("http://other.example/")
    opened = """address => new Promise(done => {
        const socket = new WebSocket(address.replace('http', 'ws') + '/ws', ['bokeh', 'x']);
        socket.onopen = () => done(true);
        socket.onerror = () => done(false);
    })"""
    read = "address => fetch(address).then(answer => answer.text()).catch(error => null)"
    assert foreign.evaluate(opened, address) is False
    assert foreign.evaluate(read, address) is None
    foreign.close()
