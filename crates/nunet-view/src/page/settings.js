// What the user chose; kept by the browser.

const KEPT = [
  "layout", "theme", "auto", "near", "far", "show-confidence", "depth-share", "label-share", "confidence-share",
  "cloud-colors",
  "max-width", "max-rate", "max-fps",
];
const KEY = "nunet-view";

export const element = (id) => document.getElementById(id);

const isCheckbox = (input) => input.type === "checkbox";

function load() {
  let kept = {};
  try {
    kept = Object(JSON.parse(localStorage.getItem(KEY)));
  } catch {
    // The browser keeps nothing, or something else wrote it: the defaults hold.
  }
  for (const id of KEPT.filter((id) => id in kept)) {
    const input = element(id);
    if (isCheckbox(input)) input.checked = kept[id];
    else if (!input.options || [...input.options].some((option) => option.value === kept[id])) input.value = kept[id];
  }
}

function save() {
  const kept = KEPT.map((id) => [id, isCheckbox(element(id)) ? element(id).checked : element(id).value]);
  try {
    localStorage.setItem(KEY, JSON.stringify(Object.fromEntries(kept)));
  } catch {
    // They hold until the page is closed.
  }
}

/** Calls `changed(id)` for each change. */
export function listen(changed) {
  load();
  for (const id of KEPT) {
    element(id).addEventListener("input", () => {
      save();
      changed(id);
    });
  }
  element("settings").addEventListener("submit", (event) => event.preventDefault());
}

const number = (id) => Number(element(id).value);

export const settings = {
  get request() {
    return {
      confidence: this.showsConfidence,
      max_width: number("max-width"),
      max_mbit_per_s: number("max-rate"),
      max_fps: number("max-fps"),
    };
  },
  get isBlended() {
    return element("layout").value === "blend";
  },
  get showsConfidence() {
    return element("show-confidence").checked;
  },
  get isAutomatic() {
    return element("auto").checked;
  },
  get range() {
    return { near: number("near"), far: Math.max(number("far"), number("near") + 1e-3) };
  },
  get shares() {
    const [depthShare, labelShare, confidenceShare] = ["depth-share", "label-share", "confidence-share"].map(number);
    return { depthShare, labelShare, confidenceShare };
  },
  get cloudColors() {
    return element("cloud-colors").value;
  },
  get theme() {
    return element("theme").value;
  },
};
