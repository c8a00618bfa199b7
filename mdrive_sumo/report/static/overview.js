// Filters of pages that list scenarios; what is chosen is kept in the address, "#bucket=InterDrive&outcome=failed".

const $ = (id) => document.getElementById(id);
const CHOICES = ["bucket", "category", "kind", "outcome"].filter((id) => $(id));

/** A scenario, with everything that its filters ask for. */
class Row {
  constructor(node) {
    this.node = node;
    this.cells = [...node.querySelectorAll(".cells > li[data-key]")];
    this.square = document.querySelector(`.overview a[href="#${CSS.escape(node.id)}"]`)?.parentElement;
    this.text = node.textContent.toLowerCase();
  }

  /** Shows what fits; whether anything does. */
  filter(wanted) {
    const { node } = this;
    const here = ["bucket", "category"].every((name) => !wanted[name] || node.dataset[name] === wanted[name]);
    const read = wanted.words.every((word) => this.text.includes(word));
    const fitting = here && read ? this.cells.filter((cell) => fits(cell.dataset, wanted)) : [];
    const keys = new Set(fitting.map((cell) => cell.dataset.key));
    for (const cell of this.cells) cell.classList.toggle("faded", !keys.has(cell.dataset.key));
    for (const line of node.querySelectorAll(".why > li[data-key]")) line.hidden = !keys.has(line.dataset.key);
    node.hidden = !fitting.length;
    this.square?.classList.toggle("faded", node.hidden);
    return fitting.length;
  }
}

function fits(cell, wanted) {
  if (wanted.outcome && cell.outcome !== wanted.outcome) return false;
  if (wanted.kind && !(cell.kinds ?? "").split(" ").includes(wanted.kind)) return false;
  return !wanted.crashed || "crashed" in cell;
}

const rows = [...document.querySelectorAll(".scenario")].map((node) => new Row(node));

function readForm() {
  const wanted = Object.fromEntries(CHOICES.map((id) => [id, $(id).value]));
  wanted.crashed = $("crashed")?.checked ?? false;
  wanted.words = $("text").value.toLowerCase().split(/\s+/).filter(Boolean);
  return wanted;
}

function showFitting() {
  const wanted = readForm();
  const counts = rows.map((row) => row.filter(wanted));
  const shown = counts.filter(Boolean).length;
  const episodes = counts.reduce((sum, count) => sum + count, 0);
  const all = rows.reduce((sum, row) => sum + row.cells.length, 0);
  const also = all > rows.length ? `, ${episodes} of ${all} ${$("matrix").dataset.unit}` : "";
  $("count").textContent = `${shown} of ${rows.length} scenarios${also}`;
  $("nothing").hidden = shown > 0;
}

function writeLink() {
  const link = new URLSearchParams();
  for (const id of CHOICES) if ($(id).value) link.set(id, $(id).value);
  if ($("crashed")?.checked) link.set("crashed", "1");
  if ($("text").value) link.set("text", $("text").value);
  history.replaceState(null, "", `#${link}`);
}

function readLink() {
  if (location.hash.startsWith("#s-")) return showScenario(location.hash.slice(3));
  const link = new URLSearchParams(location.hash.slice(1));
  for (const id of CHOICES) $(id).value = [...$(id).options].some((one) => one.value === link.get(id)) ? link.get(id) : "";
  if ($("crashed")) $("crashed").checked = link.has("crashed") && !$("crashed").disabled;
  $("text").value = link.get("text") ?? "";
  showFitting();
}

/** A scenario that the filters hide is shown again, by emptying them. */
function showScenario(id) {
  const row = rows.find((one) => one.node.id === `s-${decodeURIComponent(id)}`);
  if (row?.node.hidden) $("filters").reset();
  showFitting();
  if (row) setTimeout(() => row.node.scrollIntoView()); // after the list has its length
}

function changed() {
  showFitting();
  writeLink();
}

$("filters").addEventListener("input", changed);
$("filters").addEventListener("submit", (event) => event.preventDefault());
$("filters").addEventListener("reset", () => setTimeout(showFitting)); // after the form is empty
$("clear").addEventListener("click", () => setTimeout(writeLink));
$("show-failures")?.addEventListener("click", () => {
  $("crashed").checked = true;
  changed();
  $("matrix").scrollIntoView();
});
addEventListener("hashchange", readLink);
addEventListener("keydown", (event) => {
  if (event.key !== "/" || event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select")) return;
  event.preventDefault();
  $("text").focus();
});
readLink();
