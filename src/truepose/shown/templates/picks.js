// Points of charts: a click picks the row, in every chart and in the drawing; what is picked is ringed.
(function () {
  "use strict";
  var rows = JSON.parse(document.getElementById("data").textContent).rows;
  var series = Array.prototype.slice.call(document.querySelectorAll("svg.chart path[data-rows]"));
  var moves = new Map();

  function places(path) {
    if (!moves.has(path)) {
      var found = [], all = path.getAttribute("d").matchAll(/M(-?[\d.]+) (-?[\d.]+)/g), shift = path.classList.contains("ring") ? 2.5 : path.classList.contains("stroke") ? 3 : 0;
      for (var one of all) { found.push([parseFloat(one[1]) + shift, parseFloat(one[2])]); }
      moves.set(path, found);
    }
    return moves.get(path);
  }

  function at(svg, event) {
    var box = svg.getBoundingClientRect(), scale = svg.viewBox.baseVal.width / box.width;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
  }

  function nearest(svg, event) {
    var spot = at(svg, event), best = null, least = 14 * 14;
    svg.querySelectorAll("path[data-rows]").forEach(function (path) {
      places(path).forEach(function (place, k) {
        var far = (place[0] - spot[0]) * (place[0] - spot[0]) + (place[1] - spot[1]) * (place[1] - spot[1]);
        if (far < least) { least = far; best = k; }
      });
    });
    return best;
  }

  document.querySelectorAll("svg.chart").forEach(function (svg) {
    if (!svg.querySelector("path[data-rows]")) { return; }
    svg.style.cursor = "crosshair";
    svg.addEventListener("click", function (event) {
      var k = nearest(svg, event);
      if (k !== null) { document.dispatchEvent(new CustomEvent("pick", { detail: { row: rows[k] } })); }
    });
  });

  document.addEventListener("pick", function (event) {
    document.querySelectorAll("svg.chart .pick").forEach(function (old) { old.remove(); });
    var k = rows.indexOf(event.detail.row);
    if (k < 0) { return; }
    series.forEach(function (path) {
      var place = places(path)[k];
      if (!place || place[0] < 0) { return; }
      var ring = document.createElementNS(path.namespaceURI, "circle");
      ring.setAttribute("class", "pick");
      ring.setAttribute("cx", place[0]);
      ring.setAttribute("cy", place[1]);
      ring.setAttribute("r", 6);
      path.ownerSVGElement.appendChild(ring);
    });
  });
})();
