// Runs before the first paint, so that a page never flashes in the other colours.
(() => {
  let chosen = null;
  try {
    chosen = localStorage.getItem("versant.theme");
  } catch {
    // storage may be forbidden: then the system's wish counts
  }
  const dark = chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
})();
