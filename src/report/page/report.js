// Sorts and filters the gallery, enlarges pictures, and marks the section in view. Without it the page still tells all.
(() => {
  "use strict";
  const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
  const bar = document.querySelector("nav");
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      const link = links.get(entry.target.id);
      link?.classList.toggle("here", entry.isIntersecting);
      // On a phone the bar is wider than the screen.
      if (link && entry.isIntersecting) bar.scrollTo({ left: link.offsetLeft - (bar.clientWidth - link.offsetWidth) / 2 });
    }
  }, { rootMargin: "-20% 0px -75% 0px" });
  document.querySelectorAll("main > section").forEach((section) => seen.observe(section));

  const controls = document.getElementById("controls");
  if (!controls) return;
  const list = document.getElementById("cards");
  const count = document.getElementById("count");
  const cards = [...list.querySelectorAll(".card")];
  const words = new Map(cards.map((card) => [card, card.textContent.toLowerCase()]));
  const filters = [...controls.querySelectorAll("[data-filter]")];
  // Whether the largest comes first; what is not known comes last either way.
  const falls = { rank: false, margin: false, score: true, range: false, speed: true, samples: true };
  const none = document.createElement("p");
  none.className = "none";
  none.textContent = "No card fits.";

  function update() {
    const wanted = controls.elements.words.value.toLowerCase().split(/\s+/).filter(Boolean);
    const shown = cards.filter((card) => {
      const fits = filters.every((filter) => !filter.value || card.dataset[filter.name] === filter.value);
      const is = fits && wanted.every((word) => words.get(card).includes(word));
      card.hidden = !is;
      return is;
    });
    const key = controls.elements.sort.value;
    const value = (card) => {
      const text = card.dataset[key];
      return text === "" ? Infinity : falls[key] ? -Number(text) : Number(text);
    };
    const sorted = cards.map((card, i) => [value(card), i, card]);
    sorted.sort((a, b) => (a[0] === b[0] ? a[1] - b[1] : a[0] < b[0] ? -1 : 1));
    list.replaceChildren(...sorted.map((entry) => entry[2]), ...(shown.length ? [] : [none]));
    count.textContent = `${shown.length} of ${cards.length}`;
  }
  controls.addEventListener("input", update);
  controls.addEventListener("submit", (event) => event.preventDefault());
  // A reset takes effect after its event.
  controls.addEventListener("reset", () => setTimeout(update));
  update();

  const large = document.getElementById("large");
  let current = null;
  function show(card) {
    current = card;
    const images = [...card.querySelectorAll("img")].map((image) => {
      const copy = image.cloneNode();
      copy.loading = "eager";
      return copy;
    });
    large.querySelector(".large-pictures").replaceChildren(...images);
    const parts = [card.querySelector("h4"), ...card.querySelectorAll(".facts li"), card.querySelector(".sample")];
    large.querySelector(".large-text").textContent = parts.map((part) => part.textContent.trim()).join(" · ");
    if (!large.open) large.showModal();
  }
  function step(by) {
    const visible = [...list.querySelectorAll(".card:not([hidden])")].filter((card) => card.querySelector("img"));
    const next = visible[visible.indexOf(current) + by];
    if (next) show(next);
  }
  list.addEventListener("click", (event) => {
    const button = event.target.closest(".pictures");
    if (button) show(button.closest(".card"));
  });
  large.addEventListener("click", (event) => {
    if (event.target === large) large.close();
    if (event.target.dataset?.step) step(Number(event.target.dataset.step));
  });
  large.addEventListener("keydown", (event) => {
    if (event.key === "ArrowLeft") step(-1);
    if (event.key === "ArrowRight") step(1);
  });
})();
