// Draws the laws that were found, and the waveforms of one recording at a time. The data stand in the page as JSON, the samples in single precision.
(function () {
  "use strict";

  const data = JSON.parse(document.getElementById("data").textContent);
  const waves = data.waves;
  const choice = document.getElementById("recording");
  const plot = document.getElementById("waves");
  const along = document.getElementById("along");
  // measured, before and after differ in lightness, in colour (told apart by every kind of sight) and in their dashes
  const LINES = {
    measured: { color: "#a3acb3", width: 4 },
    before: { color: "#d55e00", width: 1.5, dash: "5px,3px" },
    after: { color: "#0072b2", width: 1.4 },
  };
  const LABELS = {
    measured: "measured",
    before: "before, as believed",
    after: "after, as found",
  };
  const WAVE_HEIGHT = 210;
  const RESIDUAL_HEIGHT = 110;
  const LAW_HEIGHT = 350;
  const GAP = 26;
  const TOP = 58;
  const BOTTOM = 48;
  const CONFIG = {
    displaylogo: false,
    doubleClick: "autosize",
    // a campaign is its lab's: no button offers to upload it
    plotlyServerURL: "",
    modeBarButtonsToRemove: ["sendChartToCloud", "sendDataToCloud", "select2d", "lasso2d", "autoScale2d"],
    toImageButtonOptions: { format: "svg", filename: "waveforms" },
  };
  const FONT = { family: getComputedStyle(document.body).fontFamily, size: 13, color: "#1c2329" };

  function lawAxis(title) {
    return {
      title: { text: title },
      gridcolor: "#e8ebed",
      linecolor: "#9aa4ac",
      showline: true,
      zerolinecolor: "#9aa4ac",
      exponentformat: "power",
    };
  }

  // The curve over its band, what the recordings show of it, and the nearest equation of the library.
  function drawLaw(law, i) {
    if (!law) {
      return;
    }
    const traces = [
      {
        x: law.x.concat(law.x.slice().reverse()),
        y: law.high.concat(law.low.slice().reverse()),
        fill: "toself",
        fillcolor: "rgba(0, 114, 178, 0.2)",
        line: { width: 0 },
        hoverinfo: "skip",
        mode: "lines",
        name: "95 % band",
      },
    ];
    if (law.seen) {
      traces.push({
        x: law.seen.x,
        y: law.seen.y,
        error_y: { type: "data", array: law.seen.std, color: "#a3acb3", thickness: 1, width: 0 },
        mode: "markers",
        marker: { color: "#7b858d", size: 5 },
        name: "recordings (partial residuals)",
      });
    }
    if (law.nearest) {
      traces.push({
        x: law.x,
        y: law.nearest.y,
        mode: "lines",
        line: { color: "#d55e00", width: 1.5, dash: "5px,3px" },
        name: "nearest equation, " + law.nearest.form,
      });
    }
    traces.push({ x: law.x, y: law.y, mode: "lines", line: { color: "#0072b2", width: 2 }, name: "law, " + law.form });
    const place = document.getElementById("law-" + i);
    const layout = {
      width: place.clientWidth,
      height: LAW_HEIGHT,
      font: Object.assign({}, FONT),
      margin: { l: 84, r: 12, t: 12, b: 48 },
      paper_bgcolor: "#fff",
      plot_bgcolor: "#fff",
      xaxis: lawAxis(law.argument),
      yaxis: lawAxis(law.value),
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", xanchor: "left" },
    };
    Plotly.newPlot(place, traces, layout, CONFIG);
  }

  function floats(text) {
    return new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  }

  function spaced(wave) {
    return Float64Array.from(floats(wave.time), (offset) => wave.begin + offset);
  }

  function axisTitle(text, unit) {
    return { text: unit ? text + "<br>" + unit : text, standoff: 6 };
  }

  // Rows of a figure from top to bottom, each an axis y, y2, ... over the same x.
  function stacked(rows) {
    const inner = rows.reduce((sum, row) => sum + row.height, 0) + GAP * (rows.length - 1);
    const layout = {
      width: plot.clientWidth,
      height: inner + TOP + BOTTOM,
      margin: { l: 96, r: 12, t: TOP, b: BOTTOM },
      font: Object.assign({}, FONT),
      paper_bgcolor: "#fff",
      plot_bgcolor: "#fff",
      dragmode: "zoom",
      hovermode: "x unified",
      legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom", xanchor: "left", yref: "paper" },
    };
    let below = inner;
    rows.forEach((row, i) => {
      layout["yaxis" + (i ? i + 1 : "")] = {
        domain: [Math.max(0, (below - row.height) / inner), below / inner],
        anchor: "x",
        title: row.title,
        rangemode: row.rangemode || "normal",
        zeroline: true,
        zerolinecolor: "#9aa4ac",
        gridcolor: "#e8ebed",
        linecolor: "#9aa4ac",
        showline: true,
        exponentformat: "power",
        nticks: row.height > 150 ? 7 : 4,
      };
      below -= row.height + GAP;
    });
    layout.xaxis = {
      anchor: "y" + (rows.length > 1 ? rows.length : ""),
      title: { text: "time, s" },
      gridcolor: "#e8ebed",
      linecolor: "#9aa4ac",
      showline: true,
      zeroline: false,
    };
    return layout;
  }

  function line(x, y, kind, row, legend, width) {
    return {
      type: "scatter",
      mode: "lines",
      x: x,
      y: y,
      name: LABELS[kind],
      legendgroup: kind,
      showlegend: legend,
      line: width ? { color: LINES[kind].color, width: width } : LINES[kind],
      yaxis: row ? "y" + (row + 1) : "y",
      connectgaps: false,
      hovertemplate: "%{y:.4~g}<extra>" + kind + "</extra>",
    };
  }

  function drawWaves(wave) {
    const time = spaced(wave);
    const rows = [];
    const lines = [];
    const known = new Set();
    function add(y, kind, width) {
      lines.push(line(time, y, kind, rows.length - 1, !known.has(kind), width));
      known.add(kind);
    }
    wave.traces.forEach((trace) => {
      const alone = !trace.before && !trace.after;
      rows.push({ height: alone ? RESIDUAL_HEIGHT : WAVE_HEIGHT, title: axisTitle(trace.channel, trace.unit) });
      const measured = floats(trace.measured);
      const simulated = ["before", "after"].filter((kind) => trace[kind]).map((kind) => [kind, floats(trace[kind])]);
      add(measured, "measured", alone ? 2 : 0);
      simulated.forEach(([kind, series]) => add(series, kind));
      if (simulated.length) {
        rows.push({ height: RESIDUAL_HEIGHT, title: axisTitle("residual", trace.unit) });
        simulated.forEach(([kind, series]) => add(measured.map((value, i) => value - series[i]), kind));
      }
    });
    const layout = stacked(rows);
    layout.xaxis.range = wave.view.slice();
    return Plotly.react(plot, lines, layout, CONFIG);
  }

  function drawAlong(wave) {
    const traces = wave.traces.filter((trace) => trace.along);
    document.getElementById("along-part").hidden = !traces.length;
    if (!traces.length) {
      return;
    }
    const lines = [];
    const rows = traces.map((trace, i) => {
      const time = floats(trace.along.time);
      ["before", "after"].forEach((kind) => {
        if (trace.along[kind]) {
          lines.push(line(time, floats(trace.along[kind]), kind, i, i === 0));
        }
      });
      return { height: 96, title: axisTitle(trace.channel, trace.unit), rangemode: "tozero" };
    });
    const layout = stacked(rows);
    layout.xaxis.range = wave.span.slice();
    layout.shapes = [
      {
        type: "rect", xref: "x", yref: "paper", x0: wave.part[0], x1: wave.part[1], y0: 0, y1: 1,
        fillcolor: "#1c2329", opacity: 0.1, line: { width: 0 }, layer: "below",
      },
    ];
    Plotly.react(along, lines, layout, CONFIG);
  }

  function seconds(ends) {
    const length = ends[1] - ends[0];
    return length < 1 ? (1000 * length).toPrecision(3) + " ms" : length.toPrecision(3) + " s";
  }

  function draw() {
    const wave = waves[Number(choice.value)];
    drawWaves(wave);
    drawAlong(wave);
    plot.setAttribute("aria-label", "measured and simulated waveforms of " + wave.name + ", residuals below them");
    document.getElementById("shown").textContent =
      (wave.held ? "held out of the fit" : "fitted") +
      (wave.whole
        ? ", " + seconds(wave.span) + ", all of it"
        : ", " + seconds(wave.part) + " of " + seconds(wave.span) + ", every sample, where the mismatch is largest");
    document.getElementById("previous").disabled = choice.selectedIndex === 0;
    document.getElementById("next").disabled = choice.selectedIndex === choice.length - 1;
  }

  function move(step) {
    choice.selectedIndex = Math.min(Math.max(choice.selectedIndex + step, 0), choice.length - 1);
    draw();
  }

  data.laws.forEach(drawLaw);
  if (!waves.length) {
    return;
  }
  choice.addEventListener("change", draw);
  document.getElementById("previous").addEventListener("click", () => move(-1));
  document.getElementById("next").addEventListener("click", () => move(1));
  document.getElementById("all").addEventListener("click", () => {
    Plotly.relayout(plot, { "xaxis.range": waves[Number(choice.value)].part.slice() });
  });

  // Paper is narrower than a screen, and lower: half a sheet for the waveforms. A browser that lays the page out for
  // paper resizes it too, which is not for Plotly to follow, so its own way of following the window is not used.
  const PAPER = { width: 700, share: 0.55, size: 10 };
  let printing = false;

  function drawn() {
    return [plot, along, ...document.querySelectorAll(".law")].filter((each) => each && each.data);
  }

  window.addEventListener("resize", () => {
    if (!printing) {
      drawn().forEach((each) => Plotly.relayout(each, { width: each.clientWidth }));
    }
  });
  window.addEventListener("beforeprint", () => {
    printing = true;
    drawn().forEach((each) => {
      each.heightOnScreen = each.layout.height;
      Plotly.relayout(each, { width: PAPER.width, height: PAPER.share * each.layout.height, "font.size": PAPER.size });
    });
  });
  window.addEventListener("afterprint", () => {
    printing = false;
    drawn().forEach((each) => {
      Plotly.relayout(each, { width: each.clientWidth, height: each.heightOnScreen, "font.size": FONT.size });
    });
  });

  draw();
})();
