// The frequency laboratory: a slider of frequency, a mark on the response, and the cars' waves.
// Each car's gain at every frequency comes once; moving the slider asks nothing of the server.

const POINTS_A_PERIOD = 32, POINTS = 160, ROOM = 1.3, REPORT_MS = 250, NEAR = 24;

const signed = (value, digits) => (value < 0 ? "" : "+") + written(value, digits);
const frequency = (omega) => `${Number(omega.toPrecision(4))} rad/s`;

// The cars' complex amplitudes at a frequency, leader first; null from one on that never settles.
const amplitudes = (data, at) => {
  let [re, im] = [data.amplitude, 0], settles = true;
  const chain = [[re, im]];
  for (const which of data.order) {
    const [a, b] = [data.gains[which][0][at], data.gains[which][1][at]];
    settles &&= a !== null && b !== null;
    [re, im] = [re * a - im * b, re * b + im * a];
    chain.push(settles ? [re, im] : null);
  }
  return chain;
};

class Laboratory {
  constructor(root) {
    this.root = root;
    this.slider = root.querySelector("input");
    this.output = root.querySelector("output");
    this.chips = root.querySelector(".chips");
    this.svg = root.querySelector("svg");
    this.axes = element("g", {}, this.svg);
    this.lines = element("g", { fill: "none", "stroke-linejoin": "round" }, this.svg);
    this.words = element("g", {}, this.svg);
    this.pointer = element("text", { class: "pointer", "text-anchor": "end" }, this.svg);
    this.slider.addEventListener("input", () => this.move(Number(this.slider.value)));
    for (const event of ["pointerup", "blur"]) {
      this.slider.addEventListener(event, () => this.tell());
    }
    this.svg.addEventListener("pointermove", (event) => this.point(event));
    this.svg.addEventListener("pointerleave", () => this.point(null));
    this.sizes = new ResizeObserver(() => this.resized());
    this.sizes.observe(this.svg);
    this.mark = element("svg", { class: "laboratory-mark", "aria-hidden": "true" });
    this.mark.style.cssText = "position:absolute;inset:0;width:100%;height:100%;pointer-events:none";
    this.redrawn = () => this.draw_mark();
    this.watch = new MutationObserver(() => this.find_response());
  }

  // New data from Python; what the user has moved since it was asked for stays.
  take(data, report) {
    const is_other = String(this.data?.omega) !== String(data.omega);
    this.data = data;
    this.report = report;
    if (is_other || this.pending === data.index) this.pending = this.told = undefined;
    this.at = Math.min(this.pending ?? data.index, data.omega.length - 1);
    this.slider.max = data.omega.length - 1;
    this.svg.style.height = `${data.height}px`;
    this.chips.replaceChildren(...data.chips.map(({ name, index, help }) => {
      const chip = document.createElement("button");
      chip.type = "button";
      chip.title = help;
      chip.textContent = name;
      chip.addEventListener("click", () => this.move(index));
      chip.dataset.index = index;
      return chip;
    }));
    this.paths = data.names.map((_, k) => element("path",
      { stroke: data.colours[k], "stroke-width": data.widths[k] }));
    this.lines.replaceChildren(...this.paths.slice(1), this.paths[0]);
    const chart = document.querySelector(`.st-key-${data.response}`);
    this.watch.disconnect();
    if (chart) this.watch.observe(chart, { childList: true, subtree: true });
    this.find_response();
    this.resized();
  }

  move(at) {
    this.at = this.pending = at;
    this.draw();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.tell(), REPORT_MS);
  }

  // Report where the slider stands, once.
  tell() {
    clearTimeout(this.timer);
    if (this.pending === undefined || this.pending === this.told) return;
    this.told = this.pending;
    this.report(this.data.omega[this.pending]);
  }

  resized() {
    this.width = this.svg.clientWidth;
    if (this.data && this.width) this.draw();
  }

  draw() {
    const { data, at } = this, omega = data.omega[at];
    this.slider.value = at;
    this.slider.setAttribute("aria-valuetext", frequency(omega));
    this.slider.style.setProperty("--share", `${(100 * at) / (data.omega.length - 1)}%`);
    this.output.textContent = frequency(omega);
    for (const chip of this.chips.children) {
      chip.setAttribute("aria-pressed", Number(chip.dataset.index) === at);
    }
    this.draw_waves(omega);
    this.draw_mark();
    this.svg.dataset.omega = omega;
  }

  draw_waves(omega) {
    const { data, width } = this, { height } = data;
    const [w, h] = [width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom];
    const period = (2 * Math.PI) / omega, end = Math.max(data.shown, data.periods * period);
    this.chain = amplitudes(data, this.at);
    const sizes = this.chain.map((part) => part && Math.hypot(...part));
    const most = Math.max(data.amplitude * data.growth, ...sizes.filter((size) => size !== null));
    const top = ROOM * most;
    const x = (time) => MARGIN.left + (time / end) * w;
    const y = (value) => MARGIN.top + (0.5 - value / top / 2) * h;
    this.scale = { omega, end, w, h, x, y, top };
    const count = Math.max(POINTS, Math.round((POINTS_A_PERIOD * end) / period));
    const times = Array.from({ length: count + 1 }, (_, k) => (k * end) / count);
    const [sines, cosines] = [times.map((t) => Math.sin(omega * t)),
                              times.map((t) => Math.cos(omega * t))];
    const across = times.map((t) => x(t).toFixed(1));
    this.chain.forEach((part, k) => {
      this.paths[k].setAttribute("d", part ? "M" + across.map((left, i) =>
        `${left},${y(part[0] * sines[i] + part[1] * cosines[i]).toFixed(1)}`).join("L") : "");
    });
    if (this.axes_of !== `${end} ${top} ${width} ${height}`) {
      this.axes_of = `${end} ${top} ${width} ${height}`;
      draw_axes(this.axes, { left: MARGIN.left, top: MARGIN.top, width: w, height: h },
        { low: 0, high: end, title: data.time }, { low: -top, high: top, title: data.speed },
        data.grid);
    }
    const last = sizes.length - 1, settled = sizes.indexOf(null);
    const level = (y(top) + y(most)) / 2, [from, to] = [x(period / 4), x(1.25 * period)];
    this.words.replaceChildren();
    const [right, bottom] = [width - MARGIN.right, height - MARGIN.bottom - 6];
    say(data.platoon, { class: "platoon", x: right, y: bottom - 16, "text-anchor": "end" },
      this.words);
    element("path", { class: "period", stroke: data.mark,
      d: `M${from},${level - 4}v8m0,-4H${to}m0,-4v8` }, this.words);
    say(`one period: ${written(period, 1)} s`, { x: to + 6, y: level + 4 }, this.words);
    this.svg.dataset.last = settled < 0 ? sizes[last].toFixed(2) : "";
    say(settled < 0 ? `last follower ${written(sizes[last], 2)} m/s, leader ${written(sizes[0], 2)}`
      : `${data.names[settled]} never settles`,
      { x: right, y: bottom, "text-anchor": "end" }, this.words);
  }

  // The line nearest to the pointer, with its car and speed.
  point(event) {
    this.pointer.textContent = "";
    this.paths?.forEach((path, k) => path.setAttribute("stroke-width", this.data.widths[k]));
    if (!event || !this.scale) return;
    const box = this.svg.getBoundingClientRect(), { end, w, y, omega } = this.scale;
    const time = ((event.clientX - box.left - MARGIN.left) / w) * end;
    if (time < 0 || time > end) return;
    const speeds = this.chain.map((part) => part &&
      part[0] * Math.sin(omega * time) + part[1] * Math.cos(omega * time));
    const away = speeds.map((speed) => speed === null ? Infinity
      : Math.abs(y(speed) - event.clientY + box.top));
    const nearest = away.indexOf(Math.min(...away));
    if (away[nearest] > NEAR) return;
    this.paths[nearest].setAttribute("stroke-width", 4);
    this.pointer.setAttribute("x", this.width - MARGIN.right);
    this.pointer.setAttribute("y", MARGIN.top + 12);
    this.pointer.textContent = `${this.data.names[nearest]}: ${signed(speeds[nearest], 2)} m/s`
      + ` at ${written(time, 1)} s`;
  }

  // The chart of the response is Plotly's, which may draw it anew at any time.
  find_response() {
    const chart = document.querySelector(`.st-key-${this.data.response} .js-plotly-plot`);
    if (chart && chart !== this.chart && chart.on) {
      this.chart = chart;
      for (const event of ["plotly_afterplot", "plotly_relayout"]) chart.on(event, this.redrawn);
      this.draw_mark();
    }
  }

  draw_mark() {
    const layout = this.chart?._fullLayout;
    if (!layout?.xaxis?._length || !this.data) return;
    if (this.mark.parentNode !== this.chart) this.chart.append(this.mark);
    const { data, at } = this, { xaxis, yaxis } = layout, omega = data.omega[at];
    const ink = getComputedStyle(this.svg).color;
    const paper = getComputedStyle(this.root.host).getPropertyValue("--st-background-color");
    const left = xaxis._offset + xaxis.d2p(omega), isSeen = left >= xaxis._offset
      && left <= xaxis._offset + xaxis._length;
    const [top, bottom] = [yaxis._offset, yaxis._offset + yaxis._length];
    this.mark.replaceChildren();
    if (isSeen) {
      element("path", { d: `M${left},${top}V${bottom}`, stroke: data.mark, "stroke-width": 1.5,
        "stroke-dasharray": "2 3" }, this.mark);
    }
    const size = 15, rows = data.curves.length, look = { "font-size": 12, fill: ink,
      "paint-order": "stroke", stroke: paper, "stroke-width": 3, "stroke-linejoin": "round" };
    say(`at ${frequency(omega)}:`, { ...look, x: xaxis._offset + 6, y: bottom - 8 - size * rows },
      this.mark);
    data.curves.forEach(({ name, colour, values }, k) => {
      const value = values[at], down = value === null ? NaN : top + yaxis.d2p(value);
      if (isSeen && down >= top && down <= bottom) {
        element("circle", { cx: left, cy: down, r: 5, fill: colour, stroke: data.mark,
          "stroke-width": 2 }, this.mark);
      }
      const y = bottom - 8 - size * (rows - 1 - k);
      element("rect", { x: xaxis._offset + 6, y: y - 6, width: 12, height: 3, fill: colour },
        this.mark);
      const said = element("text", { ...look, x: xaxis._offset + 74, y, "text-anchor": "end",
        "data-curve": k }, this.mark);
      said.textContent = value === null ? "–" : `${signed(value, data.decimals)} ${data.unit}`;
      say(name, { ...look, x: xaxis._offset + 82, y }, this.mark);
    });
  }

  end() {
    clearTimeout(this.timer);
    this.sizes.disconnect();
    this.watch.disconnect();
    this.mark.remove();
    for (const event of ["plotly_afterplot", "plotly_relayout"]) {
      this.chart?.removeListener?.(event, this.redrawn);
    }
  }
}

export default function ({ parentElement, data, setTriggerValue }) {
  parentElement.laboratory ??= new Laboratory(parentElement);
  parentElement.laboratory.take(data, (omega) => setTriggerValue("omega", omega));
  return () => {
    parentElement.laboratory?.end();
    delete parentElement.laboratory;
  };
}
