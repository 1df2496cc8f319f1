// Gives each row of a table that is wider than the screen a line per column.
"use strict";
(() => {
  const fit = () => {
    for (const frame of document.querySelectorAll(".wide")) {
      frame.classList.remove("stacked");
      frame.classList.toggle("stacked", frame.scrollWidth > frame.clientWidth);
    }
  };
  window.addEventListener("resize", fit);
  document.addEventListener("toggle", fit, true);  // of a table that is unfolded: a folded one has no width
  fit();
})();
