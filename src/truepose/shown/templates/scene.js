// The machine, turned by hand: its poses, the points that were measured, and residuals as enlarged arrows.
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("data").textContent).scene;
  var svg = document.getElementById("machine");
  if (!data || !svg) { return; }
  var NAMES = svg.namespaceURI, LARGE = 168, AT_REST = { turn: -0.6, rise: 0.38, zoom: 1 };
  var view = Object.assign({}, AT_REST), pose = 0, shown = 2, alone = false;
  var scale = LARGE / data.steps, mm = LARGE / data.size;
  var usual = typical(data.arrows[0] || []), larger = 1;
  var parts = {};

  function typical(arrows) {
    var sum = 0, n = arrows.length / 3;
    for (var k = 0; k < arrows.length; k++) { sum += arrows[k] * arrows[k]; }
    return n && sum > 0 ? Math.sqrt(sum / n) * 1e-6 : 1;  // mm
  }

  function made(name, kind) {
    var one = document.createElementNS(NAMES, name);
    if (kind) { one.setAttribute("class", kind); }
    svg.appendChild(one);
    return one;
  }

  ["floor", "ghost", "point", "before", "after", "rail", "axis", "link", "plate", "leg", "tool", "guilty"].forEach(function (kind) {
    parts[kind] = made("path", kind);
  });
  ["point", "before", "after"].forEach(function (kind) { parts["own" + kind] = made("path", "own " + kind); });
  var marks = data.guilty.map(function (pieces, k) {
    var mark = { spot: made("circle"), text: made("text", "mark"), pieces: pieces };
    mark.spot.setAttribute("r", 8);
    mark.text.textContent = k + 1;
    return mark;
  });
  var ruler = made("path", "ruler"), length = made("text");

  function seen(x, y, z) {
    var ct = Math.cos(view.turn), st = Math.sin(view.turn), cr = Math.cos(view.rise), sr = Math.sin(view.rise);
    var across = ct * x - st * y, away = st * x + ct * y;
    return [view.zoom * across, -view.zoom * (z * cr + away * sr)];
  }

  function point(list, k) { return seen(scale * list[3 * k], scale * list[3 * k + 1], scale * list[3 * k + 2]); }

  function word(spot) { return spot[0].toFixed(1) + " " + spot[1].toFixed(1); }

  function line(list, piece) {
    var way = "";
    if (piece.k === "axis") {
      var a = piece.p[0], b = piece.p[1], back = [0, 1, 2].map(function (i) { return 2 * list[3 * a + i] - list[3 * b + i]; });
      return "M" + word(point(back, 0)) + "L" + word(point(list, b));
    }
    piece.p.forEach(function (k, n) { way += (n ? "L" : "M") + word(point(list, k)); });
    return piece.c ? way + "Z" : way;
  }

  function times() { return larger * 0.1 * data.size / usual; }

  function arrow(from, list, k) {
    var f = 1e-6 * times() * mm;
    var tip = seen(from[0] + f * list[3 * k], from[1] + f * list[3 * k + 1], from[2] + f * list[3 * k + 2]);
    var start = seen(from[0], from[1], from[2]), dx = tip[0] - start[0], dy = tip[1] - start[1], long = Math.hypot(dx, dy);
    var way = "M" + word(start) + "L" + word(tip);
    if (long < 2) { return way; }
    var head = Math.min(5, 0.4 * long) / long;
    var left = [tip[0] - head * (dx + 0.5 * dy), tip[1] - head * (dy - 0.5 * dx)];
    var right = [tip[0] - head * (dx - 0.5 * dy), tip[1] - head * (dy + 0.5 * dx)];
    return way + "M" + word(left) + "L" + word(tip) + "L" + word(right);
  }

  function machine(list) {
    var way = { rail: "", axis: "", link: "", plate: "", leg: "", tool: "", guilty: "" };
    var bad = new Set([].concat.apply([], data.guilty));
    data.pieces.forEach(function (piece, k) {
      var own = line(list, piece);
      way[piece.k] += own;
      if (bad.has(k) && piece.k !== "rail") { way.guilty += own; }
    });
    Object.keys(way).forEach(function (kind) { parts[kind].setAttribute("d", way[kind]); });
    var taken = [];
    marks.forEach(function (mark) {
      if (!mark.pieces.length) { mark.spot.setAttribute("r", 0); mark.text.textContent = ""; return; }
      var corners = data.pieces[mark.pieces[0]].p, x = 14, y = -12;
      corners.slice(0, 2).forEach(function (k) { var p = point(list, k); x += p[0] / 2; y += p[1] / 2; });
      var touches = function (other) { return Math.hypot(other[0] - x, other[1] - y) < 18; };
      while (taken.some(touches)) { x += 18; }
      taken.push([x, y]);
      mark.spot.setAttribute("cx", x);
      mark.spot.setAttribute("cy", y);
      mark.text.setAttribute("x", x);
      mark.text.setAttribute("y", y + 3.5);
    });
  }

  function points() {
    var row = data.poseRows[pose], way = { point: "", before: "", after: "", ownpoint: "", ownbefore: "", ownafter: "" };
    data.pointRows.forEach(function (own, k) {
      var from = [scale * data.points[3 * k], scale * data.points[3 * k + 1], scale * data.points[3 * k + 2]];
      var mine = own === row;
      if (alone && !mine) { return; }
      way[(mine ? "own" : "") + "point"] += "M" + word(seen(from[0], from[1], from[2])) + "h0";
      data.arrows.forEach(function (list, which) {
        if (shown !== 2 && shown !== which && data.arrows.length > 1) { return; }
        var kind = data.arrows.length > 1 && which === 0 ? "before" : "after";
        way[(mine ? "own" : "") + kind] += arrow(from, list, k);
      });
    });
    Object.keys(way).forEach(function (kind) { parts[kind].setAttribute("d", way[kind]); });
  }

  function ghosts() {
    var way = "";
    if (!alone) {
      var step = Math.max(1, Math.ceil(data.poses.length / 24));
      for (var k = 0; k < data.poses.length; k += step) {
        data.pieces.forEach(function (piece) { if (piece.k !== "axis" && piece.k !== "rail") { way += line(data.poses[k], piece); } });
      }
    }
    parts.ghost.setAttribute("d", way);
  }

  function floor() {
    var low = Infinity, way = "", list = data.poses[0];
    for (var k = 2; k < list.length; k += 3) { low = Math.min(low, list[k]); }
    for (var n = -4; n <= 4; n++) {
      var u = 0.8 * n * LARGE / 4, z = scale * low;
      way += "M" + word(seen(u, -0.8 * LARGE, z)) + "L" + word(seen(u, 0.8 * LARGE, z)) + "M" + word(seen(-0.8 * LARGE, u, z)) + "L" + word(seen(0.8 * LARGE, u, z));
    }
    parts.floor.setAttribute("d", way);
  }

  function rule() {
    var raw = 70 / (mm * view.zoom), power = Math.pow(10, Math.floor(Math.log10(raw)));
    var round = [1, 2, 5].map(function (n) { return n * power; }).filter(function (n) { return n <= raw; }).pop() || power;
    ruler.setAttribute("d", "M-200 150v-4v4h" + (round * mm * view.zoom).toFixed(1) + "v-4");
    length.textContent = round < 1 ? 1000 * round + " µm" : round >= 1000 ? round / 1000 + " m" : round + " mm";
    length.setAttribute("x", -200);
    length.setAttribute("y", 142);
  }

  function draw() { floor(); ghosts(); machine(data.poses[pose]); points(); rule(); }

  function tell() {
    var joints = data.joints.map(function (name, k) {
      var parts = name.split(" ");
      return parts[0] + " " + data.q[pose][k] + (parts[1] === "°" ? "°" : parts[1] ? " " + parts[1] : "");
    });
    var errors = data.errors[pose];
    var said = errors.length > 1 ? "before: " + errors[0] + "; after: " + errors[1] : errors[0];
    document.getElementById("told").textContent = data.where[pose] + ". Error " + said + ". " + joints.join(", ");
  }

  function take(k, tellOthers) {
    pose = Math.max(0, Math.min(data.poses.length - 1, k));
    document.getElementById("pose").value = pose;
    draw();
    tell();
    if (tellOthers) { document.dispatchEvent(new CustomEvent("pick", { detail: { row: data.poseRows[pose], from: "scene" } })); }
  }

  function told(factor) {
    var digits = Math.pow(10, Math.floor(Math.log10(factor)) - 1);
    return "×" + (factor < 10 ? factor.toFixed(1) : (Math.round(factor / digits) * digits).toLocaleString("en"));
  }

  function enlarge() {
    larger = Math.pow(10, parseFloat(document.getElementById("larger").value));
    document.getElementById("times").textContent = told(times());
  }

  function spot(event) {
    var box = svg.getBoundingClientRect(), shape = svg.viewBox.baseVal;
    var by = Math.max(shape.width / box.width, shape.height / box.height);
    return [(event.clientX - box.left - box.width / 2) * by, (event.clientY - box.top - box.height / 2) * by];
  }

  function nearest(place) {
    var best = -1, least = 18 * 18;
    function offer(seenAt, k) {
      var far = Math.pow(seenAt[0] - place[0], 2) + Math.pow(seenAt[1] - place[1], 2);
      if (far < least) { least = far; best = k; }
    }
    data.pointRows.forEach(function (row, n) {
      var k = data.poseRows.indexOf(row);
      if (k >= 0) { offer(point(data.points, n), k); }
    });
    if (!data.pointRows.length) { data.poses.forEach(function (list, k) { offer(point(list, list.length / 3 - 1), k); }); }
    return best;
  }

  var held = null, moved = false;
  svg.addEventListener("pointerdown", function (event) {
    held = [event.clientX, event.clientY];
    moved = false;
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", function (event) {
    if (!held) { return; }
    var dx = event.clientX - held[0], dy = event.clientY - held[1];
    if (!moved && Math.hypot(dx, dy) < 4) { return; }
    moved = true;
    held = [event.clientX, event.clientY];
    turn(dx * 0.01, dy * 0.01);
  });
  svg.addEventListener("pointerup", function (event) {
    if (held && !moved) {
      var k = nearest(spot(event));
      if (k >= 0) { take(k, true); }
    }
    held = null;
  });
  svg.addEventListener("wheel", function (event) {
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY));
  }, { passive: false });

  function turn(across, up) {
    view.turn += across;
    view.rise = Math.max(-1.55, Math.min(1.55, view.rise + up));
    draw();
  }

  function zoom(by) {
    view.zoom = Math.max(0.3, Math.min(30, view.zoom * by));
    draw();
  }

  svg.addEventListener("keydown", function (event) {
    var steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (steps) {
      event.preventDefault();
      if (event.shiftKey) { turn(0.1 * steps[0], 0.1 * steps[1]); } else { take(pose + steps[0] + steps[1], true); }
    } else if (event.key === "+" || event.key === "-") {
      zoom(event.key === "+" ? 1.2 : 1 / 1.2);
    }
  });

  document.getElementById("pose").max = data.poses.length - 1;
  document.getElementById("pose").addEventListener("input", function (event) { take(parseInt(event.target.value, 10), true); });
  document.getElementById("larger").addEventListener("input", function () { enlarge(); draw(); });
  document.querySelectorAll("input[name=arrows]").forEach(function (input) {
    input.addEventListener("change", function () { shown = parseInt(input.value, 10); draw(); });
    if (data.arrows.length < 2) { input.closest("fieldset").hidden = true; }
  });
  document.getElementById("alone").addEventListener("change", function (event) { alone = event.target.checked; draw(); });
  document.getElementById("turn").addEventListener("click", function () { Object.assign(view, AT_REST); draw(); });
  document.addEventListener("pick", function (event) {
    var k = data.poseRows.indexOf(event.detail.row);
    if (event.detail.from !== "scene" && k >= 0) { take(k, false); }
  });
  enlarge();
  take(data.first, false);
})();
