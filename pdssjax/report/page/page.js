"use strict";
// Zooms and moves each figure by its viewBox, and says at which coordinates of its axes the pointer is.
const MOST = 200;
for (const svg of document.querySelectorAll("figure svg")) {
  const [left, top, width, height] = svg.getAttribute("viewBox").split(/[\s,]+/).map(Number);
  const axes = JSON.parse(svg.dataset.axes);
  let [x, y, shown] = [left, top, width];  // the corner of what is shown, and how wide that is
  let held = null;  // the point of the figure that is dragged

  const within = (value, low, high) => Math.min(Math.max(value, low), Math.max(high, low));
  const show = () => {
    const tall = height * shown / width;
    [x, y] = [within(x, left, left + width - shown), within(y, top, top + height - tall)];
    svg.setAttribute("viewBox", `${x} ${y} ${shown} ${tall}`);
    svg.classList.toggle("near", shown < width);
  };
  const zoom = (factor, [atX, atY]) => {
    const next = within(shown * factor, width / MOST, width);
    if (next === shown) return false;
    [x, y] = [atX - (atX - x) * next / shown, atY - (atY - y) * next / shown];
    shown = next;
    show();
    return true;
  };
  const whole = () => { [x, y, shown] = [left, top, width]; show(); };
  const middle = () => [x + shown / 2, y + height * shown / width / 2];
  const place = (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [point.x, point.y];
  };

  const tools = document.createElement("div");
  const said = document.createElement("span");
  tools.className = "tools";
  const explained = "wheel or + and \u2212: zoom; drag or arrows: move; double click or 0: whole figure";
  const buttons = [["+", "Zoom in", () => zoom(0.7, middle())], ["\u2212", "Zoom out", () => zoom(1 / 0.7, middle())],
    ["whole", "Show the whole figure", whole]];
  for (const [sign, label, act] of buttons) {
    const button = document.createElement("button");
    [button.type, button.textContent, button.title] = ["button", sign, label];
    button.setAttribute("aria-label", label);
    button.addEventListener("click", act);
    tools.append(button);
  }
  said.textContent = explained;
  tools.append(said);
  svg.after(tools);

  const coordinates = ([atX, atY]) => {
    const [acrossFigure, downFigure] = [(atX - left) / width, (atY - top) / height];
    const here = axes.find(({ place: [x0, y0, x1, y1] }) =>
      acrossFigure >= x0 && acrossFigure <= x1 && downFigure >= y0 && downFigure <= y1);
    if (!here) return explained;
    const [[x0, y0, x1, y1], [low, high, bottom, upper], [nameX, nameY]] = [here.place, here.edges, here.labels];
    const across = low + (high - low) * (acrossFigure - x0) / (x1 - x0);
    const up = upper + (bottom - upper) * (downFigure - y0) / (y1 - y0);
    const digits = (value, span) => value.toFixed(within(3 - Math.floor(Math.log10(Math.abs(span))), 0, 12));
    const near = shown / width;
    return `${nameX}: ${digits(across, near * (high - low))}, ${nameY}: ${digits(up, near * (upper - bottom))}`;
  };

  svg.setAttribute("tabindex", "0");
  svg.addEventListener("wheel", (event) => {
    // Where nothing is left to zoom out of, the page scrolls.
    if (zoom(Math.exp(within(event.deltaY, -200, 200) / 400), place(event))) event.preventDefault();
  }, { passive: false });
  svg.addEventListener("pointerdown", (event) => {
    if (event.button || (event.pointerType === "touch" && shown === width)) return;
    held = place(event);
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    const at = place(event);
    said.textContent = coordinates(at);
    if (!held) return;
    [x, y] = [x + held[0] - at[0], y + held[1] - at[1]];
    show();
  });
  for (const name of ["pointerup", "pointercancel"]) svg.addEventListener(name, () => { held = null; });
  svg.addEventListener("pointerleave", () => { said.textContent = explained; });
  svg.addEventListener("dblclick", whole);
  svg.addEventListener("keydown", (event) => {
    const step = shown / 10;
    const act = { "+": () => zoom(0.7, middle()), "=": () => zoom(0.7, middle()), "-": () => zoom(1 / 0.7, middle()),
      "0": whole, "Home": whole, "ArrowLeft": () => { x -= step; show(); }, "ArrowRight": () => { x += step; show(); },
      "ArrowUp": () => { y -= step; show(); }, "ArrowDown": () => { y += step; show(); } }[event.key];
    // Arrows scroll the page while all of the figure is shown.
    if (!act || event.ctrlKey || event.metaKey || (event.key.startsWith("Arrow") && shown === width)) return;
    act();
    event.preventDefault();
  });
}
// What is folded is printed, too.
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((each) => { each.open = true; }));
