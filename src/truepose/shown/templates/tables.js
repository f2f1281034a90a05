// Tables that sort by a column, are copied as CSV, and details that are open in print.
(function () {
  "use strict";
  document.querySelectorAll("table.sortable").forEach(function (table) {
    var body = table.tBodies[0];
    table.querySelectorAll("th").forEach(function (head, column) {
      var button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      head.textContent = "";
      head.appendChild(button);
      button.addEventListener("click", function () {
        var up = head.getAttribute("aria-sort") !== "ascending";
        table.querySelectorAll("th").forEach(function (other) { other.removeAttribute("aria-sort"); });
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        var rows = Array.prototype.slice.call(body.rows);
        rows.sort(function (a, b) { return (up ? 1 : -1) * compared(a.cells[column].textContent, b.cells[column].textContent); });
        rows.forEach(function (row) { body.appendChild(row); });
      });
    });
  });

  function compared(a, b) {
    var x = number(a), y = number(b);
    if (isNaN(x) && isNaN(y)) { return a.localeCompare(b, undefined, { numeric: true }); }
    if (isNaN(x)) { return 1; }
    return isNaN(y) ? -1 : x - y;
  }

  function number(text) {
    var plain = text.replace(/,/g, "").replace(/\u2212/g, "-").replace(/×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/, function (all, power) {
      return "e" + power.replace(/⁻/g, "-").replace(/[⁰¹²³⁴⁵⁶⁷⁸⁹]/g, function (digit) { return "⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(digit); });
    });
    return parseFloat(plain);
  }

  document.querySelectorAll("button.copy").forEach(function (button) {
    button.addEventListener("click", function () {
      var said = button.textContent;
      copied(button.dataset.csv).then(function () {
        button.textContent = "Copied";
      }, function () {
        button.textContent = "The browser does not allow it";
      }).then(function () { setTimeout(function () { button.textContent = said; }, 2000); });
    });
  });

  function copied(text) {
    if (navigator.clipboard && window.isSecureContext) { return navigator.clipboard.writeText(text); }
    var area = document.createElement("textarea");
    area.value = text;
    document.body.appendChild(area);
    area.select();
    var done = document.execCommand("copy");
    area.remove();
    return done ? Promise.resolve() : Promise.reject();
  }

  var opened = [];
  window.addEventListener("beforeprint", function () {
    opened = Array.prototype.filter.call(document.querySelectorAll("details"), function (one) { return !one.open; });
    opened.forEach(function (one) { one.open = true; });
  });
  window.addEventListener("afterprint", function () { opened.forEach(function (one) { one.open = false; }); });
})();
