(function () {
  "use strict";
  const root = document.documentElement;
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];

  // ---- Plots

  const settings = {
    displaylogo: false,
    scrollZoom: false, // the wheel scrolls the page
    showSendToCloud: false,
    showEditInChartStudio: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
    topojsonURL: "",
    plotlyServerURL: "",
    typesetMath: false, // a dollar sign is one
  };

  /** What a plot takes from the page's theme, as keys of Plotly.relayout. */
  function themeOf(layout) {
    const style = getComputedStyle(root);
    const shade = (name) => style.getPropertyValue("--" + name).trim();
    const update = {
      "font.color": shade("ink"),
      "hoverlabel.bgcolor": shade("panel"),
      "hoverlabel.bordercolor": shade("axis"),
      "hoverlabel.font.color": shade("ink"),
      "modebar.color": shade("muted"),
      "modebar.activecolor": shade("ink"),
      "modebar.bgcolor": "rgba(0,0,0,0)",
    };
    const axes = layout.scene
      ? ["scene.xaxis", "scene.yaxis", "scene.zaxis"]
      : ["xaxis", "yaxis"];
    for (const axis of axes) {
      update[axis + ".gridcolor"] = shade("grid");
      update[axis + ".linecolor"] = shade("axis");
      update[axis + ".tickcolor"] = shade("axis");
      update[axis + ".color"] = shade("ink");
    }
    return update;
  }

  /** The error bars of bars have the colour of the text. */
  const inkedTraces = (data) =>
    data.flatMap((trace, i) => (trace.type === "bar" && trace.error_y ? [i] : []));

  async function retheme(plot) {
    const update = themeOf(plot.layout);
    await Plotly.relayout(plot, update);
    const bars = inkedTraces(plot.data);
    if (bars.length) await Plotly.restyle(plot, { "error_y.color": update["font.color"] }, bars);
  }

  /** The same before a plot is drawn, so that it is drawn once. */
  function addTheme(data, layout) {
    const update = themeOf(layout);
    for (const [path, value] of Object.entries(update)) {
      const keys = path.split(".");
      const last = keys.pop();
      keys.reduce((part, key) => (part[key] ??= {}), layout)[last] = value;
    }
    for (const i of inkedTraces(data)) data[i].error_y.color = update["font.color"];
  }

  /** A plot is as wide as its place, whatever changes that: a window, a scroll bar, a font. */
  const places = new ResizeObserver((entries) => {
    for (const { target: plot } of entries) {
      const { width, height } = plot._fullLayout;
      const isShown = plot.clientWidth > 0; // it is not where its picture stands for it
      if (isShown && (plot.clientWidth !== width || plot.clientHeight !== height)) {
        Plotly.Plots.resize(plot);
      }
    }
  });

  async function drawPlot(source) {
    const plot = document.getElementById(source.dataset.of);
    try {
      const { data, layout } = JSON.parse(source.textContent);
      // A finger that moves over a plot scrolls the page.
      if (!layout.scene && matchMedia("(pointer: coarse)").matches) layout.dragmode = false;
      if (layout.scene && plot.clientWidth < 500) {
        // All of it fits, and labels have room.
        for (const axis of "xyz") layout.scene.camera.eye[axis] *= 1.55;
        for (const axis of ["xaxis", "yaxis", "zaxis"]) layout.scene[axis].dtick *= 2;
        layout.font.size = 11;
      }
      addTheme(data, layout);
      await Plotly.newPlot(plot, data, layout, settings);
      places.observe(plot);
    } catch (error) {
      plot.closest("figure").classList.add("undrawn"); // its picture stands there instead
      console.error(error);
    }
  }

  async function drawPlots() {
    for (const source of all(".plot-data")) {
      await drawPlot(source);
      await new Promise((next) => setTimeout(next)); // the page stays alive meanwhile
    }
  }

  // ---- Theme

  const button = document.querySelector(".theme");
  const preference = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  try {
    chosen = localStorage.getItem("iout-report-theme");
  } catch (refused) {
    // Some browsers keep nothing for files.
  }

  function setTheme(theme) {
    root.dataset.theme = theme;
    button.textContent = theme === "dark" ? "Light theme" : "Dark theme";
    return Promise.all(all(".js-plotly-plot").map(retheme));
  }

  button.hidden = false;
  button.addEventListener("click", () => {
    chosen = root.dataset.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem("iout-report-theme", chosen);
    } catch (refused) {
      // Then it holds until the page is left.
    }
    setTheme(chosen);
  });
  preference.addEventListener("change", () => {
    if (!chosen) setTheme(preference.matches ? "dark" : "light");
  });

  // ---- Commands

  async function copy(code) {
    try {
      await navigator.clipboard.writeText(code.textContent);
      return "Copied";
    } catch (refused) {
      getSelection().selectAllChildren(code);
      return document.execCommand("copy") ? "Copied" : "Selected";
    }
  }

  for (const copier of all(".copy")) {
    const before = copier.innerHTML;
    copier.setAttribute("aria-live", "polite");
    copier.addEventListener("click", async () => {
      copier.textContent = await copy(copier.parentElement.querySelector("code"));
      setTimeout(() => (copier.innerHTML = before), 1600);
    });
  }

  // ---- Claims by verdict

  for (const filter of all(".filter")) {
    const buttons = all("button", filter);
    const answers = all(".answer", filter.parentElement);
    filter.hidden = false;
    filter.addEventListener("click", (event) => {
      const pressed = event.target.closest("button");
      if (!pressed) return;
      const verdict = pressed.dataset.verdict;
      for (const other of buttons) other.setAttribute("aria-pressed", String(other === pressed));
      for (const answer of answers) {
        answer.hidden = verdict !== "" && answer.dataset.verdict !== verdict;
      }
      const shown = answers.filter((answer) => !answer.hidden).length;
      filter.querySelector("[role=status]").textContent = shown + " claims shown";
    });
  }
  // A link to a claim that the filter hides shows it.
  addEventListener("hashchange", () => {
    const target = document.getElementById(location.hash.slice(1));
    if (target && target.hidden) {
      target.closest(".answers").querySelector(".filter button").click();
      target.scrollIntoView();
    }
  });

  setTheme(root.dataset.theme);
  window.reportReady = drawPlots();
})();
