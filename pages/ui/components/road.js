// The cars of a platoon on the road, seen from the leader, and below them their speeds.

const ROAD = { top: 22, height: 62 }, SPEEDS_TOP = 104, HEIGHT = 372;
const MARGIN_M = 3, DASH_M = 12, BRAKES = -0.15, PLAYED_S = 20, RATES = [1, 2, 5, 10, 20, 50, 100];
const LEAST_CAR = 12, GAP_WIDTH = 44;
// The side of a car of length 1 whose front is at 0 and whose wheels stand on 0.
const BODY = "M0,-.08Q.01,-.2-.06,-.22L-.22,-.25L-.36,-.38Q-.5,-.4-.72,-.385L-.88,-.27L-.98,-.25"
  + "Q-1,-.15-.99,-.08Z";
const WINDOW = "M-.26,-.25L-.375,-.35Q-.5,-.365-.7,-.355L-.8,-.26Z";

class Road {
  constructor(root) {
    [this.button, this.slider, this.output, this.svg] =
      ["button", "input", "output", "svg"].map((name) => root.querySelector(name));
    for (const name of ["axes", "road", "cars", "speeds"]) this[name] = element("g", {}, this.svg);
    this.svg.style.height = `${HEIGHT}px`;
    this.button.addEventListener("click", () => this.playing ? this.pause() : this.play());
    this.slider.addEventListener("input", () => {
      this.pause();
      this.draw(Number(this.slider.value));
    });
    this.sizes = new ResizeObserver(() => this.resized());
    this.sizes.observe(this.svg);
  }

  take(data) {
    const is_same = JSON.stringify(data) === this.text;
    this.text = JSON.stringify(data);
    if (is_same) return;
    this.pause();
    this.data = data;
    const [first, last] = [data.time[0], data.time.at(-1)];
    this.rate = RATES.find((rate) => (last - first) / rate <= PLAYED_S) ?? RATES.at(-1);
    Object.assign(this.slider, { min: first, max: last });
    this.now = first;
    const places = data.places.flat().filter((value) => value !== null);
    const speeds = data.speeds.flat().filter((value) => value !== null);
    const [low, high] = [Math.min(...speeds), Math.max(...speeds)], rim = 0.1 * (high - low) + 0.05;
    this.ends = { rear: Math.min(...places) - data.length - MARGIN_M, front: MARGIN_M,
      low: low - rim, high: high + rim };
    this.cars.replaceChildren();
    this.speeds.replaceChildren();
    this.wave = element("path", { class: "wave" }, this.speeds);
    this.drawn = data.names.map((name, k) => {
      const car = element("g", { class: "car" }, this.cars);
      element("title", {}, car).textContent = name;
      const side = element("g", {}, car);
      element("path", { d: BODY, fill: data.colours[k] }, side);
      element("path", { d: WINDOW, class: "window" }, side);
      const brake = element("rect", { class: "brake", x: -1, y: -0.25, width: 0.06, height: 0.09 },
        side);
      for (const cx of [-0.2, -0.79]) {
        element("circle", { class: "wheel", cx, cy: -0.085, r: 0.085 }, side);
      }
      const number = element("text", { "text-anchor": "middle" }, car);
      number.textContent = data.numbers[k];
      const gap = element("text", { "text-anchor": "middle" }, this.cars);
      const dot = element("circle", { r: 5, fill: data.colours[k] }, this.speeds);
      element("title", {}, dot).textContent = name;
      return { car, side, brake, number, gap, dot };
    });
    this.resized();
  }

  resized() {
    this.width = this.svg.clientWidth;
    if (!this.data || !this.width) return;
    const { rear, front, low, high } = this.ends, w = this.width - MARGIN.left - MARGIN.right;
    const h = HEIGHT - SPEEDS_TOP - MARGIN.bottom;
    this.metre = w / (front - rear);
    this.x = (place) => MARGIN.left + (place - rear) * this.metre;
    this.y = (speed) => SPEEDS_TOP + ((high - speed) / (high - low)) * h;
    draw_axes(this.axes, { left: MARGIN.left, top: SPEEDS_TOP, width: w, height: h },
      { low: rear, high: front, title: this.data.position },
      { low, high, title: this.data.speed }, this.data.grid);
    this.road.replaceChildren();
    element("rect", { class: "asphalt", x: MARGIN.left, y: ROAD.top, width: w,
      height: ROAD.height }, this.road);
    const dash = DASH_M * this.metre / 2;
    this.lane = element("path", { class: "lane", "stroke-dasharray": `${dash} ${dash}`,
      d: `M${MARGIN.left},${ROAD.top + ROAD.height - 8}h${w}` }, this.road);
    this.draw(this.now);
  }

  // Values of each vehicle at an instant, straight between the samples; null after a collision.
  at(rows, index, share) {
    return rows.map((row) => row[index] === null || row[index + 1] === null ? null
      : row[index] + share * (row[index + 1] - row[index]));
  }

  draw(now) {
    this.now = now;
    const { data, metre } = this, { time } = data;
    let index = Math.min(time.length - 2, Math.max(0, this.index ?? 0));
    if (time[index] > now) index = 0;
    while (index < time.length - 2 && time[index + 1] <= now) index++;
    this.index = index;
    const step = time[index + 1] - time[index], share = (now - time[index]) / step;
    const [places, speeds] = [data.places, data.speeds].map((rows) => this.at(rows, index, share));
    const [way] = this.at([data.way], index, share);
    this.lane.setAttribute("stroke-dashoffset", (way % DASH_M) * metre);
    const length = Math.max(data.length * metre, LEAST_CAR), floor = ROAD.top + ROAD.height - 14;
    const path = [];
    this.drawn.forEach(({ car, side, brake, number, gap, dot }, k) => {
      const is_there = places[k] !== null;
      for (const part of [car, dot, gap]) part.style.display = is_there ? "" : "none";
      if (!is_there) return;
      const x = this.x(places[k]), y = this.y(speeds[k]);
      side.setAttribute("transform", `translate(${x} ${floor}) scale(${length})`);
      const slowing = (data.speeds[k][index + 1] - data.speeds[k][index]) / step < BRAKES;
      brake.style.display = slowing ? "" : "none";
      number.setAttribute("x", x - length / 2);
      number.setAttribute("y", ROAD.top - 6);
      dot.setAttribute("cx", x);
      dot.setAttribute("cy", y);
      path.push(`${x.toFixed(1)},${y.toFixed(1)}`);
      const ahead = k ? places[k - 1] - data.length - places[k] : 0;
      gap.textContent = k && ahead * metre > GAP_WIDTH ? `${written(ahead, 1)} m` : "";
      gap.setAttribute("x", this.x(places[k] + ahead / 2));
      gap.setAttribute("y", floor - 8);
    });
    this.wave.setAttribute("d", `M${path.join("L")}`);
    this.slider.value = now;
    this.slider.setAttribute("aria-valuetext", `${written(now, 1)} s`);
    const share_done = (now - time[0]) / (time.at(-1) - time[0]);
    this.slider.style.setProperty("--share", `${100 * share_done}%`);
    const larger = length / (data.length * metre);
    this.output.textContent = `${written(now, 1)} s · ${this.rate} × real time`
      + (larger > 1.05 ? ` · cars enlarged ${written(larger, 1)} ×` : "");
    this.svg.dataset.places = places.map((place) => place === null ? "" : place.toFixed(2));
  }

  play() {
    const { time } = this.data, end = time.at(-1);
    if (this.now >= end) this.now = time[0];
    let before = performance.now();
    const step = (moment) => {
      const next = this.now + (this.rate * Math.max(0, moment - before)) / 1000;
      before = moment;
      this.draw(Math.min(end, next));
      if (this.now >= end) this.pause();
      else this.playing = requestAnimationFrame(step);
    };
    this.playing = requestAnimationFrame(step);
    this.button.textContent = "❚❚ Pause";
  }

  pause() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    this.button.textContent = "▶ Play";
  }

  end() {
    this.pause();
    this.sizes.disconnect();
  }
}

export default function ({ parentElement, data }) {
  parentElement.road ??= new Road(parentElement);
  parentElement.road.take(data);
  return () => {
    parentElement.road?.end();
    delete parentElement.road;
  };
}
