// The frequency laboratory: a slider of frequency, a mark on the response, and the cars' waves.
// Each car's gain at every frequency comes once; moving the slider asks nothing of the server, nor
// does a change of the cars' control, of which the browser computes the responses itself.

const POINTS_A_PERIOD = 32, POINTS = 160, ROOM = 1.3, REPORT_MS = 250, NEAR = 24;
const NEWTON = 12, GROWS = 1e-6, FOLLOWED = 300, BELOW = 1e-3, NARROW = 640, LOWEST = 170;

const signed = (value, digits) => (value < 0 ? "" : "+") + written(value, digits);
const frequency = (omega) => `${Number(omega.toPrecision(4))} rad/s`;

const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];

// A car [α, β, τ, λ, d] with other time gap and delay; equations: accpinn/stability/what_if.py.
const changed = ([alpha, beta, tau, lag, delay], change) =>
  [alpha, beta, Math.max(tau + change.time_gap, 0), lag, Math.max(delay + change.delay, 0)];

// Whether a car's own motion decays, by its phase margin; or it has none.
const decays = ([alpha, beta, tau, lag, delay]) => {
  const total = alpha * tau + beta;
  if (alpha === 0 && beta === 0) return true;
  if (!(total > 0) || (!lag && !delay)) return total > 0;
  let square = (total ** 2 + Math.sqrt(total ** 4 + 4 * alpha ** 2)) / 2;
  for (let k = 0; k < NEWTON; k++) {  // where the loop's gain is 1
    const excess = square ** 2 * (1 + lag ** 2 * square) - total ** 2 * square - alpha ** 2;
    square -= excess / (2 * square + 3 * lag ** 2 * square ** 2 - total ** 2);
  }
  const omega = Math.sqrt(square), turn = omega * delay;
  return Math.atan2(omega * total, alpha)
    > 2 * Math.atan2(turn / 2, 1 - turn ** 2 / 12) + Math.atan(lag * omega);
};

// H(jω) of a car that is also given a share of the acceleration ahead, some time after.
const response = ([alpha, beta, tau, lag, delay], { feedforward, latency }, omega) => {
  const x = omega ** 2, q = [1 - (delay ** 2 * x) / 12, (delay * omega) / 2];
  const [own, ahead] = [delay, latency].map((late) =>
    [Math.cos(late * omega), -Math.sin(late * omega)]);
  const inertia = times([-x, -lag * x * omega], q);
  const control = times([alpha, (alpha * tau + beta) * omega], [q[0], -q[1]]);
  const given = times(own, [alpha, beta * omega]);
  const upper = times([given[0] - feedforward * x * ahead[0],
                       given[1] - feedforward * x * ahead[1]], q);
  const [re, im] = [inertia[0] + control[0], inertia[1] + control[1]], size = re ** 2 + im ** 2;
  return times(upper, [re / size, -im / size]);
};

// The cars' complex amplitudes, leader first, from their gains; null from one on that never settles.
const amplitudes = (data, gains) => {
  let part = [data.amplitude, 0], settles = true;
  const chain = [part];
  for (const which of data.order) {
    const gain = gains[which];
    settles &&= gain !== null;
    if (settles) part = times(part, gain);
    chain.push(settles ? part : null);
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
    this.box = root.querySelector(".what-if");
    this.opener = root.querySelector(".opens");
    this.opener.addEventListener("click", () => {
      this.box.hidden = !this.box.hidden;
      this.opener.setAttribute("aria-expanded", !this.box.hidden);
      this.resized();
    });
    this.status = this.box.querySelector("b");
    this.changes = [...this.box.querySelectorAll("input")];
    for (const input of this.changes) input.addEventListener("input", () => this.change());
    this.box.querySelector("button").addEventListener("click", () => {
      this.put_back();
      this.change();
    });
    this.sizes = new ResizeObserver(() => this.data && this.resized());
    this.sizes.observe(this.svg);
    this.mark = element("svg", { class: "laboratory-mark", "aria-hidden": "true" });
    this.mark.style.cssText = "position:absolute;inset:0;width:100%;height:100%;pointer-events:none";
    this.redrawn = () => this.draw_mark();
    this.watch = new MutationObserver(() => this.find_response());
  }

  // New data from Python; what the user has moved since it was asked for stays.
  take(data, report) {
    const is_other = String(this.data?.omega) !== String(data.omega);
    const are_others = this.data && String(this.data.cars) !== String(data.cars);
    this.data = data;
    this.report = report;
    if (is_other || this.pending === data.index) this.pending = this.told = undefined;
    this.at = Math.min(this.pending ?? data.index, data.omega.length - 1);
    this.slider.max = data.omega.length - 1;
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
    if (are_others) this.put_back();
    this.compute();
    this.resized();
  }

  change() {
    this.compute();
    if (this.width) this.draw();
  }

  put_back() {
    for (const input of this.changes) input.value = 0;
  }

  // Take what the sliders of the change say, and compute the curves that it makes.
  compute() {
    const change = Object.fromEntries(this.changes.map((input) => {
      const value = Number(input.value), { unit = "" } = input.dataset;
      const signs = Number(input.min) < 0 ? signed(value, 2) : written(value, 2);
      input.parentElement.querySelector("output").textContent = `${signs} ${unit}`.trim();
      const share = (value - input.min) / (input.max - input.min);
      input.style.setProperty("--share", `${100 * share}%`);
      return [input.dataset.change, value];
    }));
    const is_changed = change.time_gap || change.delay || change.feedforward;
    this.if = is_changed ? this.changed(change) : null;
    for (const part of [this.box, this.opener, this.svg]) {
      part.classList.toggle("changed", Boolean(this.if));
    }
    this.status.textContent = this.if ? this.if.says : "";
    this.box.dataset.peaks = this.if ? JSON.stringify(this.if.peaks) : "";
  }

  // The changed cars, their largest gains, and the curves of the response at all frequencies.
  changed(change) {
    const { data } = this, cars = data.cars.map((car) => changed(car, change));
    const settles = cars.map(decays);
    const gain = (k, omega) => settles[k] ? response(cars[k], change, omega) : null;
    const sizes = cars.map((_, k) => data.omega.map((omega) => {
      const of_car = gain(k, omega);
      return of_car && Math.hypot(...of_car);
    }));
    const peaks = sizes.map((row, k) => settles[k] ? Math.max(1, ...row) : null);
    const rows = data.unit === "dB" ? sizes.map((row) => row.map((size) =>
      size === null ? null : 20 * Math.log10(size))) : cars.map((_, k) => this.phases(gain, k));
    if (cars.length > 1) {
      rows.push(data.omega.map((_, i) => rows.some((row) => row[i] === null) ? null
        : rows.reduce((total, row) => total + row[i], 0)));
    }
    const most = Math.max(...peaks.map((peak) => peak ?? Infinity));
    const says = most === Infinity ? "A car itself becomes unstable."
      : most > 1 + GROWS ? `Largest growth ${most.toFixed(2)}×` : "No frequency grows.";
    return { gain, peaks, rows, says };
  }

  // Degrees of a car's response at all frequencies, followed from 0 at ω = 0.
  phases(gain, k) {
    const { omega } = this.data, low = BELOW * omega[0];
    const before = Array.from({ length: FOLLOWED }, (_, i) => low * (1 / BELOW) ** (i / FOLLOWED));
    let [last, total] = [0, 0];
    const along = [...before, ...omega].map((at) => {
      const of_car = gain(k, at);
      if (of_car === null) return null;
      const angle = Math.atan2(of_car[1], of_car[0]), step = angle - last;
      total += step - 2 * Math.PI * Math.round(step / (2 * Math.PI));
      last = angle;
      return (180 / Math.PI) * total;
    });
    return along.slice(FOLLOWED);
  }

  // The complex gains of the platoon's different cars at the frequency chosen.
  gains() {
    const { data, at } = this;
    if (this.if) return data.different.map((k) => this.if.gain(k, data.omega[at]));
    return data.gains.map(([re, im]) => re[at] === null || im[at] === null ? null
      : [re[at], im[at]]);
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

  // The sliders of a change take their place from the waves, where these stand beside the response.
  resized() {
    this.width = this.svg.clientWidth;
    const taken = innerWidth > NARROW ? this.box.offsetHeight : 0;
    this.height = Math.max(this.data.height - taken, LOWEST);
    this.svg.style.height = `${this.height}px`;
    if (this.width) this.draw();
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
    this.box.dataset.gains = this.if ? JSON.stringify(data.cars.map((_, k) => {
      const gain = this.if.gain(k, omega);
      return gain && Math.hypot(...gain);
    })) : "";
  }

  draw_waves(omega) {
    const { data, width, height } = this;
    const [w, h] = [width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom];
    const period = (2 * Math.PI) / omega, end = Math.max(data.shown, data.periods * period);
    this.chain = amplitudes(data, this.gains());
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
    this.lines.setAttribute("stroke-dasharray", this.if ? "7 4" : "none");
    if (this.if) {
      say("What if", { class: "changed", x: right, y: MARGIN.top + 14, "text-anchor": "end" },
        this.words);
    }
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
    say(`${this.if ? "what if, " : ""}at ${frequency(omega)}:`, { ...look, x: xaxis._offset + 6, y: bottom - 8 - size * rows },
      this.mark);
    if (this.if) this.draw_changed(xaxis, yaxis);
    data.curves.forEach(({ name, colour, values: estimated }, k) => {
      const value = (this.if ? this.if.rows[k] : estimated)[at], down = value === null ? NaN : top + yaxis.d2p(value);
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

  // The curves of the changed cars over those of the estimate.
  draw_changed(xaxis, yaxis) {
    const { data } = this, [top, bottom] = [yaxis._offset, yaxis._offset + yaxis._length];
    const [left, right] = [xaxis._offset, xaxis._offset + xaxis._length];
    const across = data.omega.map((omega) => left + xaxis.d2p(omega));
    data.curves.forEach(({ colour }, k) => {
      let pen = "M", path = "";
      this.if.rows[k].forEach((value, i) => {
        const x = across[i], y = value === null ? NaN : top + yaxis.d2p(value);
        const isSeen = x >= left && x <= right && y >= top && y <= bottom;
        if (isSeen) path += `${pen}${x.toFixed(1)},${y.toFixed(1)}`;
        pen = isSeen ? "L" : "M";
      });
      element("path", { fill: "none", stroke: colour, "stroke-width": 2, "stroke-dasharray": "7 4",
        d: path }, this.mark);
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
