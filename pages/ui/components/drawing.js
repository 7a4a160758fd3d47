// What all pictures that the browser draws share; it comes before the code of each.

const SVG = "http://www.w3.org/2000/svg";
const MARGIN = { left: 62, right: 14, top: 10, bottom: 42 };

const element = (name, attributes = {}, parent) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent?.append(made);
  return made;
};
const say = (text, attributes, parent) => {
  element("text", attributes, parent).textContent = text;
};
const written = (value, digits) => (value < 0 ? "−" : "") + Math.abs(value).toFixed(digits);

// About so many round steps between two ends.
const ticks = (low, high, count) => {
  const raw = (high - low) / count, decade = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * decade).find((size) => size >= raw);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const values = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) values.push(k * step);
  return values.map((value) => [value, written(value, digits)]);
};

// Grid, numbers and titles of both axes, within a box.
const draw_axes = (group, box, across, up, colour) => {
  group.replaceChildren();
  const { left, top, width, height } = box, bottom = top + height;
  for (const [value, text] of ticks(across.low, across.high, width / 90)) {
    const x = left + ((value - across.low) / (across.high - across.low)) * width;
    element("path", { stroke: colour, d: `M${x},${top}v${height}` }, group);
    say(text, { x, y: bottom + 16, "text-anchor": "middle" }, group);
  }
  for (const [value, text] of ticks(up.low, up.high, height / 45)) {
    const y = bottom - ((value - up.low) / (up.high - up.low)) * height;
    element("path", { stroke: colour, d: `M${left},${y}h${width}` }, group);
    say(text, { x: left - 6, y: y + 4, "text-anchor": "end" }, group);
  }
  say(across.title, { class: "title", x: left + width / 2, y: bottom + 36,
    "text-anchor": "middle" }, group);
  say(up.title, { class: "title", "text-anchor": "middle",
    transform: `translate(18 ${top + height / 2}) rotate(-90)` }, group);
};
