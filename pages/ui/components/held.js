// A chart that has changed is taken down and put up again; meanwhile its last picture stays.

const AFTER_FRAMES = 2, KEYED = "[class*=st-key-]:not([class*=theatre_of])";

// Show a picture over the chart that takes its place, until that is drawn.
const hold = (place, picture) => {
  const drawn = () => [...place.querySelectorAll(".js-plotly-plot .main-svg")].length > 0;
  if (drawn()) return;
  const layer = document.createElement("div");
  layer.className = "held";
  layer.setAttribute("aria-hidden", "true");
  layer.style.cssText = "position:absolute;inset:0;pointer-events:none;overflow:hidden";
  for (const svg of picture.querySelectorAll(".main-svg")) {
    svg.style.position = "absolute";
    layer.append(svg);
  }
  place.style.position = "relative";
  place.querySelectorAll(":scope > .held").forEach((earlier) => earlier.remove());
  place.append(layer);
  let frames = 0;
  const look = () => {
    if (!layer.isConnected) return;
    if (drawn() && ++frames >= AFTER_FRAMES) layer.remove();
    else requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
};

export default function ({ parentElement }) {
  const box = (parentElement.host ?? parentElement).closest("[class*=st-key-theatre_of]");
  if (!box) return undefined;
  const pictures = new Map();
  const watch = new MutationObserver((changes) => {
    for (const { target, removedNodes } of changes) {
      for (const node of removedNodes) {
        const picture = node.matches?.(".plot-container") ? node
          : node.querySelector?.(".plot-container");
        const chart = picture && (target.closest?.(KEYED) ?? picture.closest(KEYED));
        const key = chart?.className.match(/st-key-\S+/)?.[0];
        if (key) pictures.set(key, picture);
      }
    }
    for (const [key, picture] of pictures) {  // the next chart may come a moment later
      const place = box.querySelector(`.${key}`);
      if (place) {
        hold(place, picture);
        pictures.delete(key);
      }
    }
  });
  watch.observe(box, { childList: true, subtree: true });
  return () => watch.disconnect();
}
