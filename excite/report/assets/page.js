// What makes a page answer: tables that sort, plots with one cursor. Without it the page is the same, standing still.
"use strict";
const excite = {
  // A table of packed.py, column by column: excite.unpack(block).then(columns => …).
  async unpack(block) {
    const bytes = Uint8Array.from(atob(block.data), (c) => c.charCodeAt(0));
    const inflated = new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate")));
    const steps = new DataView(await inflated.arrayBuffer());
    return block.low.map((low, column) => {
      const out = new Float64Array(block.rows);
      let sum = 0;
      for (let row = 0; row < block.rows; row++) {
        sum = (sum + steps.getUint16(2 * (column * block.rows + row), true)) & 65535;
        out[row] = sum === 65535 ? NaN : low + block.step[column] * sum;
      }
      return out;
    });
  },

  island(id) {
    return JSON.parse(document.getElementById(id).textContent);
  },

  color(role) {
    return getComputedStyle(document.documentElement).getPropertyValue("--" + role).trim();
  },

  make(tag, className, text) {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  },

  // Three significant digits, as the page's tables have them.
  number(value) {
    if (value === null || value === undefined || Number.isNaN(value)) return "–";
    const size = Math.abs(value);
    const text = size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(2) : value.toPrecision(3);
    return (size >= 1e3 && size < 1e5 ? String(Math.round(value)) : text).replace("-", "−");
  },

  whenShown(element, work) {
    new IntersectionObserver((entries, observer) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      work();
    }, { rootMargin: "400px" }).observe(element);
  },

  // One plot: {title, unit, series: [{label, role, dash, values}], lines: [{label, value}]}, beside others of a group.
  plot(holder, spec, time, group) {
    const finite = (values) => Array.from(values, (value) => (Number.isFinite(value) ? value : null));
    const series = spec.series.map((one) => ({
      label: one.label,
      stroke: () => excite.color(one.role),
      width: 1.5,
      dash: one.dash || undefined,
      spanGaps: false,
      value: (_, value) => (value === null ? "–" : excite.number(value) + " " + spec.unit),
    }));
    const level = (spec.lines || []).map((line) => ({
      label: line.label,
      class: "quiet",
      stroke: () => excite.color("bad"),
      width: 1,
      dash: [3, 3],
      value: () => excite.number(line.value) + " " + spec.unit,
    }));
    const axis = {
      stroke: () => excite.color("muted"),
      grid: { stroke: () => excite.color("grid"), width: 1 },
      ticks: { stroke: () => excite.color("grid"), width: 1 },
      font: "12px system-ui, sans-serif",
    };
    const label = (splits) => splits.map((value) => (value === null ? "" : String(+value.toPrecision(6)).replace("-", "−")));
    const made = new uPlot(
      {
        width: Math.max(240, holder.clientWidth),
        height: spec.height || 190,
        scales: { x: { time: false } },
        axes: [
          { ...axis, size: 30, values: (_, splits) => label(splits) },
          { ...axis, size: (_, texts) => Math.max(52, 16 + 7 * Math.max(0, ...(texts || []).map((text) => text.length))), values: (_, splits) => label(splits) },
        ],
        cursor: { sync: group ? { key: group, setSeries: false } : undefined, drag: { x: true, y: false } },
        legend: { live: true },
        series: [{ label: "time [s]", value: (_, value) => (value === null ? "–" : value.toFixed(2)) }, ...series, ...level],
      },
      [
        Array.from(time),
        ...spec.series.map((one) => finite(one.values)),
        ...(spec.lines || []).map((line) => Array.from(time, () => line.value)),
      ],
      holder,
    );
    if (spec.note) {
      const note = excite.make("div", "plot-note");
      holder.append(note);
      made.hooks.setCursor = [(u) => (note.textContent = u.cursor.idx === null ? "" : spec.note(u.cursor.idx))];
    }
    excite.plots.add(made);
    new ResizeObserver(() => {
      const width = Math.max(240, holder.clientWidth);
      if (Math.abs(width - made.width) > 1) made.setSize({ width, height: spec.height || 190 });
    }).observe(holder);
    return made;
  },
  plots: new Set(),

  async chart(holder) {
    const spec = excite.island(holder.dataset.chart);
    const [time] = await excite.unpack(spec.time);
    for (const panel of spec.panels) {
      const values = await excite.unpack(panel.values);
      panel.series.forEach((one, i) => (one.values = values[i]));
      const box = excite.make("div", "plot");
      box.append(excite.make("div", "plot-title", panel.title));
      holder.append(box);
      excite.plot(box, panel, time, spec.group);
    }
    holder.closest(".interactive").classList.add("ready");
  },

  sortable(table) {
    const body = table.tBodies[0];
    if (!body || body.rows.length < 3) return;
    const key = (row, column) => {
      const cell = row.cells[column];
      return cell.dataset.v !== undefined ? Number(cell.dataset.v) : cell.textContent.trim();
    };
    Array.from(table.tHead.rows[0].cells).forEach((head, column) => {
      head.tabIndex = 0;
      head.classList.add("sorts");
      head.title = "sort by this column";
      const sort = () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const order = (a, b) => {
          const [x, y] = [key(a, column), key(b, column)];
          if (typeof x !== typeof y) return typeof x === "number" ? -1 : 1;
          const sign = typeof x === "number" ? x - y : x.localeCompare(y, undefined, { numeric: true });
          return down ? -sign : sign;
        };
        body.append(...Array.from(body.rows).sort(order));
      };
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        sort();
      });
    });
  },

  start() {
    if (typeof DecompressionStream === "undefined") return; // An older browser shows the page standing still.
    document.documentElement.classList.add("live");
    document.querySelectorAll("table").forEach(excite.sortable);
    if (window.uPlot) {
      document.querySelectorAll("[data-chart]").forEach((holder) => excite.whenShown(holder, () => excite.chart(holder)));
    }
    if (window.THREE) document.querySelectorAll("[data-replay]").forEach((holder) => new Replay(holder));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => excite.plots.forEach((plot) => plot.redraw()));
  },
};
window.excite = excite;
document.addEventListener("DOMContentLoaded", () => excite.start());
