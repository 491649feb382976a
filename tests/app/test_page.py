"""Each view of the page driven as a person would, in headless Chromium without a network."""

import json
import re
import time
import tomllib

import numpy as np
import pytest
from PIL import Image

from experiments.make_pictures import BUTTONS, DOCS, words

HELD = {"delta_mu_k": "-0.13", "a": "300 s/m", "D": "37.4 um", "t_cr": "0.5 s"}  # the truth: a quick fit


def go(page, view):
    page.ask(f"location.hash = {json.dumps(f'#{view}')}")


def drawn(page, selector="#plots"):
    page.wait(f"Number(document.querySelector('{selector}').dataset.drawn) > 0")


def test_the_table_of_logs_fills_itself_and_takes_what_is_dropped(root, page):
    rows = "document.querySelectorAll('#logs tbody tr')"
    page.wait(f"{rows}.length === 2 && [...{rows}].every((row) => row.textContent.includes('accept'))")
    told = page.ask(f"[...{rows}[0].cells].map((cell) => cell.textContent)")
    assert told[1:8] == ["1_mm_per_s.csv", "stickslip-csv", "1 mm/s", "1\u00a0N", "1000\u00a0Hz", "6", "stick slip"]
    drawn_of = "document.querySelector('#logs canvas.thumbnail').getContext('2d').getImageData(0, 0, 60, 30).data"
    assert page.ask(f"{drawn_of}.some((value) => value > 0)"), "the force of a log is drawn beside its name"
    page.ask(
        "(() => { const files = new DataTransfer(), rows = Array.from({length: 50}, (_, i) => `${i / 10},1,${i % 9}`);"
        "files.items.add(new File(['time,normal force,friction force\\ns,N,N\\n' + rows.join('\\n')], '<b>new.csv'));"
        "const drop = new DragEvent('drop', {dataTransfer: files, bubbles: true});"
        "document.querySelector('#view').dispatchEvent(drop); })()"
    )
    page.wait(f"{rows}.length === 3")
    assert (root / "<b>new.csv").exists() and page.ask("document.querySelectorAll('#logs b').length") == 0


def test_a_log_is_cut_by_dragging_and_the_table_follows(root, page):
    go(page, "log?path=1_mm_per_s.csv")
    page.wait("document.querySelector('#view').dataset.seen === 'yes'")
    drawn(page)
    picture = Image.open(DOCS / "app.png").info["words"]
    assert words(page.ask(BUTTONS)) == picture, "docs/app.png is old: run experiments/make_pictures.py"
    cycles = "Number(document.querySelector('#view').innerText.match(/(\\d+) cycles/)[1])"
    slope = "document.querySelector('.classical').innerText.match(/stick stiffness N.m[^\\d]*([\\d.]+)/)[1]"
    assert page.ask(cycles) == 6 and abs(float(page.ask(slope)) - 1470) < 10
    page.drag(".u-over", (0.4, 0.5), (0.5, 0.5))
    assert page.ask("document.querySelector('#view .hover').textContent").count("cycle")
    page.press("[data-mode=window]")
    page.drag(".u-over", (0.25, 0.5), (0.75, 0.5))
    page.wait(f"{cycles} < 5")
    kept = page.ask(cycles)
    page.press("[data-mode=exclude]")
    page.drag(".u-over", (0.5, 0.5), (0.5, 0.5))
    page.wait(f"{cycles} === {kept - 1}")
    draft = next((root / ".stickslip-app" / "drafts").iterdir())
    entry = tomllib.loads(draft.read_text())["logs"][0]
    assert np.allclose([float(end.split()[0]) for end in entry["window"]], [0.45, 1.35], atol=0.02)
    assert len(entry["exclude"]) == 1
    page.press("the same cut for all logs")
    page.wait("document.getElementById('said').textContent.includes('all logs')")
    assert all("window" in log for log in tomllib.loads(draft.read_text())["logs"])
    page.call("Page.reload")
    page.wait("document.querySelector('#view').dataset.seen === 'yes'")
    page.wait(f"{cycles} === {kept - 1}")
    page.press("remove all cuts")
    page.wait(f"{cycles} === 6")
    page.press("undo")
    page.wait(f"{cycles} === {kept - 1}")
    page.visit(f"{page.ask('location.href').partition('#')[0]}#log?scene=pair.toml&number=1")
    assert page.ask("document.querySelector('#view select').value") == "5_mm_per_s.csv"


def test_the_form_and_the_text_of_a_scene_say_the_same(root, page):
    go(page, "scene?scene=pair.toml")
    page.wait("document.querySelector('#view').dataset.shown")
    text = "document.querySelector('textarea').value"
    page.type("[data-place='rig.mass']", "180 g")
    page.wait(f"{text}.includes('mass = \"180 g\"')")
    assert "# h of eq. 1" in page.ask(text), "comments stay"
    page.type("[data-place='rig.stiffness']", "12 bananas")
    page.wait("document.querySelector('[data-place=\"rig.stiffness\"]').getAttribute('aria-invalid') === 'true'")
    page.type("[data-place='rig.mass']", "180 parsecs")
    page.wait("document.querySelector('[data-place=\"rig.mass\"]').getAttribute('aria-invalid') === 'true'")
    assert "parsecs" in page.ask("document.querySelector('[role=alert]').textContent")
    assert page.ask("document.querySelectorAll('input[aria-invalid=true]').length") == 2, "both stay red"
    page.type("textarea", page.ask(text).replace("180 parsecs", "190 g").replace("12 bananas", "1500 N/m"))
    page.wait("document.querySelector('[data-place=\"rig.stiffness\"]').value === '1500 N/m'")
    page.wait("document.querySelector('[role=alert]').textContent === ''")
    page.ask("document.querySelector('[data-effect=power_law] input').click()")
    page.wait(f"{text}.includes('power_law') && !{text}.includes('velocity_weakening')")
    assert "adds" in page.ask("document.querySelector('[data-effect=contact_ageing]').textContent")
    assert "1470" in (root / "pair.toml").read_text(), "the file is as it was until it is saved"
    page.call("Page.reload")
    page.wait(f"{text}.includes('190 g')")
    page.press("save")
    page.wait("document.querySelector('.bar').dataset.saved === 'yes'")
    assert tomllib.loads((root / "pair.toml").read_text())["rig"]["mass"] == "190 g"


def test_a_slider_moves_the_simulated_force(root, page):
    go(page, "try?scene=pair.toml")
    page.wait("document.querySelector('#view').dataset.tried")
    off = "document.querySelector('#summary').textContent"
    before = page.ask(off)
    assert re.search(r"slips simulated, \d+ measured, [\d.]+ m?s (early|late) in the median", before)
    page.type("[data-parameter=mu_s]", "250")
    page.wait(f"{off} !== {json.dumps(before)}")
    page.press("start from the data")
    page.wait("document.getElementById('said').textContent.includes('started from')")
    box = "document.querySelector('[data-box=mu_s]').value"
    assert page.ask(box) != "0.6", "the sliders went along"
    page.type("[data-box=mu_s]", "0.55")
    page.wait("location.hash.includes('p.mu_s=0.55')")
    page.press("[aria-label='reset mu_s']")
    page.wait(f"{box} === '0.6'")
    page.press("use as start values of the scene")
    page.wait("document.getElementById('said').textContent.includes('start values')")
    go(page, "scene")
    page.wait("document.querySelector('textarea').value.includes('mu_s = {start = ')")


def test_a_map_that_lacks_a_speed_or_a_force_says_so(page):
    go(page, "map")  # the page complains nowhere else: see its fixture
    page.wait("document.querySelector('#view').innerText.includes('There is no map of this: the scene states no')")


CONTRAST = """(() => {
  const lum = (c) => c.map((v) => v / 255).map((v) => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const rgb = (text) => { const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number); return [r, g, b, a]; };
  const over = (c, under) => [0, 1, 2].map((i) => c[i] * c[3] + under[i] * (1 - c[3]));
  const ground = (e) => e ? over(rgb(getComputedStyle(e).backgroundColor), ground(e.parentElement)) : [255, 255, 255];
  const texts = (e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
  const words = (e) => texts(e) || e.value || e.placeholder;
  return [...document.querySelectorAll('body *')].filter((e) => e.checkVisibility() && !e.disabled && words(e)
    && !e.closest('option')).map((e) => {
      const back = ground(e), both = [lum(back), lum(over(rgb(getComputedStyle(e).color), back))];
      const [dark, light] = both.sort((a, b) => a - b);
      return [(light + 0.05) / (dark + 0.05), e.outerHTML.slice(0, 80)];
    }).filter(([ratio]) => ratio < 4.5);
})()"""
OUTLINED = "(({outlineStyle, outlineWidth}) => outlineStyle !== 'none' && parseFloat(outlineWidth) > 0)"


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (400, False)])
def test_every_view_is_readable_has_no_sideways_scroll_and_is_reached_by_tab(page, width, dark):
    page.size(width, dark=dark)
    for view in ("logs", "log", "scene?scene=pair.toml", "try", "fit", "map", "study", "rig", "plan"):
        go(page, view)
        page.wait("document.querySelector('#view').innerText.length > 20")
        assert page.ask("document.documentElement.scrollWidth - innerWidth") <= 0, view
        assert page.ask(CONTRAST) == [], view
        for _ in range(0 if dark else 20):
            for kind in ("keyDown", "keyUp"):
                page.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
            where, seen = page.ask(
                f"[document.activeElement.outerHTML.slice(0, 90), {OUTLINED}(getComputedStyle(document.activeElement))]"
            )
            assert seen or where.startswith(("<body", "<main")), (view, where)


def scene_by_hand(page):
    """Choose all logs, make a scene of them and fill in what it lacks."""
    page.wait("document.querySelectorAll('#logs tbody tr').length === 2")
    page.press("make a scene from all 2 logs")
    page.wait("document.querySelector('textarea')?.value.includes('TODO')")
    for place, value in (("rig.mass", "0.2 kg"), ("rig.stiffness", "1470 N/m"), ("rig.zeta", "0.05")):
        page.type(f"[data-place='{place}']", value)
        written = value if place == "rig.zeta" else json.dumps(value)
        page.wait(f"document.querySelector('textarea').value.includes({json.dumps(' = ' + written)})")
    page.press("Parameters: start values, bounds, fixed values")
    for name, value in HELD.items():  # one after the other, none waited for: every edit counts
        page.type(f"[data-place='parameters.{name}.fixed']", value)
    for name in HELD:
        page.wait(f"document.querySelector('textarea').value.includes('{name} = {{')")
    page.wait("document.querySelector('[role=alert]').textContent === ''")


def fit_that_outlives_its_page(page, serving, folder):
    """Start a fit, close the page in the middle of it, and open it when it has ended."""
    go(page, "fit")
    page.type("[aria-label='time limit']", "10 min")
    page.press("fit")
    page.wait("document.querySelector('.job progress')")
    assert "of at most 600 s left" in page.ask("document.querySelector('.job').innerText")
    page.call("Page.navigate", url="about:blank")
    deadline = time.monotonic() + 240
    while not (folder / "stickslip-scene" / "result.json").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    page.visit(serving.address + "#fit?path=stickslip-scene")
    page.wait("document.querySelector('#parameters tbody tr')")


def result_is_seen(page):
    """Both intervals and what they mean, the price of accuracy, residuals, and the worst cycle in its log."""
    told = page.ask("document.querySelector('#parameters').innerText")
    assert all(words in told for words in ("μₛ", "identified", "95 % interval", "rig exact"))
    assert "noise alone, to compare runs on this rig" in page.ask("document.querySelector('#view').innerText")
    price = page.ask("document.querySelector('#price').textContent")
    assert "default (taken)" in price and "tight" in price and "of it contact ageing" in price
    drawn(page, "#residuals")
    page.press("Pictures of each log (4)")
    shots = "[...document.querySelectorAll('.pictures img')]"
    page.ask(f"{shots}.forEach((one) => {{ one.loading = 'eager'; }})")
    page.wait(f"{shots}.length > 9 && {shots}.every((one) => one.complete && one.naturalWidth > 100)")
    span = "document.querySelector('#residuals').timeView.end - document.querySelector('#residuals').timeView.begin"
    whole = page.ask(span)
    page.press("[data-cycle]")
    page.wait(f"{span} < {0.5 * whole}")
    page.press("in the log")
    page.wait(
        "document.querySelector('#view').dataset.seen === 'yes' && document.querySelector('#plots').dataset.drawn"
    )
    assert page.ask("location.hash").startswith("#log?")


def map_by_hand(page, serving, folder):
    """Make a map of the fit, and drag its point."""
    go(page, "map?fit=stickslip-scene&number=1")
    page.wait("document.querySelector('#answer h3')")
    page.type("[aria-label^=points]", "4")
    page.press("make the map")
    page.wait("document.querySelector('#view').dataset.mapped === 'yes'", 240)
    first = page.ask("document.querySelector('#answer').innerText")
    page.drag("#map canvas", (0.5, 0.5), (0.9, 0.12))
    page.wait(f"document.querySelector('#answer').innerText !== {json.dumps(first)}")
    assert (folder / "stickslip-scene.map.svg").exists() and (folder / "stickslip-scene.map.csv").exists()
    assert not [log for log in serving.page.folder.found()["logs"] if "map" in log], "what the page wrote is no log"


def test_from_a_folder_of_logs_to_a_map_in_the_page_alone(root, page, serving):
    """Each job shows the command that repeats it: of that, what it may say stands in tests/app/test_server.py."""
    (root / "pair.toml").unlink()
    scene_by_hand(page)
    fit_that_outlives_its_page(page, serving, root)
    result_is_seen(page)
    map_by_hand(page, serving, root)
    commands = page.ask("[...document.querySelectorAll('#jobs code')].map((code) => code.textContent)")
    assert any(command.startswith("stickslip fit --scene scene.toml --out stickslip-scene") for command in commands)


@pytest.mark.slow
def test_a_study_is_made_of_the_chosen_logs_and_its_points_lead_to_the_fits(root, page):
    page.wait("document.querySelectorAll('#logs tbody tr').length === 2")
    go(page, "study?scene=pair.toml")
    page.type("[aria-label='label of 1_mm_per_s.csv']", "steel")
    page.type("[aria-label='label of 5_mm_per_s.csv']", "steel")
    page.press("all in one group")
    page.press("fit all groups")
    page.wait("document.querySelectorAll('#groups tbody tr').length === 1", 300)
    page.wait("!document.querySelector('.job progress')", 300)
    page.wait("document.querySelector('#forest canvas')")
    page.press("compare by material")
    page.wait("document.querySelector('#study iframe')", 240)
    go(page, "study?path=study")
    page.wait("document.querySelector('#groups a')")
    assert page.ask("document.querySelector(\"[aria-label='group of 5_mm_per_s.csv']\").value") == "pair", "kept"
    assert page.ask("document.querySelector(\"[aria-label='label of 5_mm_per_s.csv']\").value") == "steel"
    page.press("#groups a")
    page.wait("document.querySelector('#parameters tbody tr')")


def test_a_rig_is_measured_in_the_page_and_scenes_take_it(root, page):
    time, rows = np.arange(2400) / 200.0, ["t [s],Fx [N]"]
    rung, omega = np.maximum(time - 1.0, 0.0), np.sqrt(1470.0 / 0.2)
    tap = np.exp(-0.05 * omega * rung) * np.sin(omega * rung)
    for name, force in (("tap.csv", tap), ("pull.csv", 0.147 * rung)):
        force = force + 0.003 * np.random.default_rng(1).standard_normal(time.size)
        rows[1:] = [f"{t:.4f},{f:.5f}" for t, f in zip(time, force, strict=True)]
        (root / name).write_text("\n".join(rows))
    go(page, "rig")
    for name in ("tap.csv", "pull.csv"):
        page.wait(f"document.querySelector('[aria-label=\"a record of the rig: {name}\"]')")
        page.ask(f"document.querySelector('[aria-label=\"a record of the rig: {name}\"]').click()")
    page.type("[aria-label='speed of pull.csv']", "0.1 mm/s")
    page.press("measure the rig")
    page.wait("document.querySelector('[data-said=rig]')?.textContent.includes('moving mass')")
    page.wait("document.querySelector('#halves canvas')?.height > 100")
    go(page, "plan")
    page.press("make a scene before any test")
    page.wait("document.getElementById('said').textContent.includes('before.toml')")
    assert tomllib.loads((root / "before.toml").read_text())["rig"] == "rig.toml"
    go(page, "scene")
    text, place = "document.querySelector('textarea')?.value", "[data-place=rig]"
    page.wait(f"{text}?.includes('rig = \"rig.toml\"') && document.querySelector('{place}').value === 'rig.toml'")
    page.type(place, "")
    page.wait(f"!{text}.includes('rig.toml') && document.querySelector('[data-place=\"rig.mass\"]')")
    page.type("[data-place='rig.mass']", "180 g")
    page.wait(f"{text}.includes('[rig]')")
    page.type(place, "rig.toml")
    page.wait(f"{text}.includes('rig = \"rig.toml\"') && !{text}.includes('180 g')")
