// Shows the cards of the gallery that are asked for.
"use strict";
(() => {
  const form = document.querySelector(".filters"), cards = [...document.querySelectorAll(".cards li")], count = document.querySelector("[role=status]");
  const filter = () => {
    const { search, category, split } = form.elements;
    let shown = 0;
    for (const card of cards) {
      const fits = card.dataset.name.includes(search.value.trim().toLowerCase()) &&
        (!category.value || card.dataset.category === category.value) && (!split.value || card.dataset.split === split.value);
      card.hidden = !fits;
      shown += fits;
    }
    count.textContent = `${shown} of ${cards.length} objects`;
  };
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  filter();
})();
