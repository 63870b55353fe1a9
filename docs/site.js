// What the theme leaves without a name, or out of reach of the keyboard, after it has drawn a page.
document$.subscribe(() => setTimeout(() => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(".md-typeset__scrollwrap").forEach((table) => (table.tabIndex = 0));
  document.querySelectorAll(".md-code__nav").forEach((nav, number) => nav.setAttribute("aria-label", `Code block ${number + 1}`));
  document.querySelectorAll("nav.md-nav[aria-labelledby]").forEach((nav) => {
    const name = document.getElementById(nav.getAttribute("aria-labelledby"))?.textContent.trim();
    nav.removeAttribute("aria-labelledby");
    nav.setAttribute("aria-label", name ? `Section ${name}` : "Section");
  });
}));
