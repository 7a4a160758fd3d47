"use strict";
(() => {
  const root = document.documentElement;
  const source = document.getElementById("drawings").textContent;
  const drawings = JSON.parse(source);
  const plots = [...document.querySelectorAll(".plot")];
  const PRINTED = 764; // pixels: the width between the margins of a printed page, by its zoom
  const FLATTER = 0.66; // of a figure's height: two, or one below the data, fit on a page
  const wish = window.matchMedia("(prefers-color-scheme: dark)");
  let dark = wish.matches;

  const ink = () => (root.classList.contains("dark") ? "#e6ecf1" : "#1b2733");
  const looks = () => ({
    "font.color": ink(),
    "hoverlabel.bgcolor": root.classList.contains("dark") ? "#1b2733" : "#ffffff",
    "hoverlabel.font.color": ink(),
    "legend.bgcolor": "rgba(0,0,0,0)",
  });

  // A layout with these looks from the first, as drawing a figure anew takes as long as drawing it.
  function dressed(layout) {
    const found = Object.assign({ autosize: true }, structuredClone(layout));
    found.font = { family: getComputedStyle(document.body).fontFamily, size: 12 };
    for (const [path, value] of Object.entries(looks())) {
      const names = path.split(".");
      const last = names.pop();
      names.reduce((part, name) => (part[name] ??= {}), found)[last] = value;
    }
    return found;
  }

  const button = document.getElementById("side");
  function turn(side) {
    root.classList.toggle("dark", side);
    button.textContent = side ? "Light" : "Dark";
  }

  function show(side) {
    turn(side);
    for (const plot of plots) Plotly.relayout(plot, looks());
  }

  button.hidden = false;
  turn(dark);
  for (const plot of plots) {
    const { data, layout } = drawings[Number(plot.dataset.place)];
    Plotly.newPlot(plot, data, dressed(layout), { displayModeBar: false, responsive: true });
  }

  button.addEventListener("click", () => show((dark = !dark)));
  wish.addEventListener("change", () => show((dark = wish.matches)));
  for (const save of document.querySelectorAll("[data-save]")) {
    const place = Number(save.dataset.save);
    const plot = plots.find((candidate) => Number(candidate.dataset.place) === place);
    const kind = save.dataset.format;
    save.addEventListener("click", () =>
      kind === "html" ? saveAlone(JSON.parse(source)[place]) : savePicture(plot, drawings[place].name, kind),
    );
  }

  function savePicture(plot, name, format) {
    Plotly.downloadImage(plot, {
      format,
      filename: "accpinn_" + name,
      width: plot.clientWidth,
      height: plot.clientHeight,
      scale: format === "png" ? 3 : 1,
    });
  }

  // One figure as a page of its own, which can be zoomed and needs no network either.
  function saveAlone(drawing) {
    const library = document.getElementById("plotly").textContent;
    const layout = Object.assign({ autosize: true }, drawing.layout);
    // In a script element, this one included, only "<" could end it early.
    const figure = JSON.stringify([drawing.data, layout]).replaceAll("<", "\\u003c");
    const parts = [
      '<!doctype html><meta charset="utf-8"><title>accpinn_' + drawing.name + "</title>",
      '<div id="plot"></div><script>',
      library,
      "<\/script><script>const [data, layout] = ",
      figure,
      ';Plotly.newPlot("plot", data, layout, { responsive: true });<\/script>',
    ];
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob(parts, { type: "text/html" }));
    link.download = "accpinn_" + drawing.name + ".html";
    link.click();
    URL.revokeObjectURL(link.href);
  }

  // Paper is white and has a width of its own.
  window.addEventListener("beforeprint", () => {
    show(false);
    for (const plot of plots) {
      const half = plot.closest(".halves");
      const { printed, layout } = drawings[Number(plot.dataset.place)];
      Plotly.relayout(plot, {
        autosize: false,
        width: half ? PRINTED / 2 - 12 : PRINTED,
        height: printed || (half ? layout.height : FLATTER * layout.height),
        // The strip above has the colours.
        ...(printed ? { showlegend: false, "margin.t": 8 } : {}),
      });
    }
  });
  window.addEventListener("afterprint", () => {
    show(dark);
    for (const plot of plots) {
      const { height, showlegend, margin } = drawings[Number(plot.dataset.place)].layout;
      Plotly.relayout(plot, {
        autosize: true, width: null, height, showlegend: !!showlegend, "margin.t": margin.t,
      });
    }
  });
  root.dataset.drawn = String(plots.length);
})();
