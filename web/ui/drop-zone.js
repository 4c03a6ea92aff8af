// Files from the hand: dropped anywhere on the page (folders too), or chosen.

const MODEL = /\.(glb|gltf|zip)$/i;
const HDRI = /\.(hdr|exr)$/i;

/** All files under a dropped entry, as `{file, path}` with paths from the drop's top. */
async function filesUnder(entry, prefix = "") {
  const path = prefix + entry.name;
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
    return [{ file, path }];
  }
  const reader = entry.createReader();
  const children = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) break;
    children.push(...some);
  }
  return (await Promise.all(children.map((child) => filesUnder(child, `${path}/`)))).flat();
}

/** Entries must be taken before the first await: the list is emptied after the event. */
function droppedFiles(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (entries.length > 0) return Promise.all(entries.map((entry) => filesUnder(entry))).then((all) => all.flat());
  return Promise.resolve([...transfer.files].map((file) => ({ file, path: file.name })));
}

/** Pictures of environments, which are no parts of a glTF, and the other files. */
export function withoutHdris(files) {
  const isHdri = ({ path }) => HDRI.test(path);
  return { hdris: files.filter(isHdri), others: files.filter((file) => !isHdri(file)) };
}

/**
 * The model first and every path seen from the model's folder, as its URIs are; files outside that folder are no part
 * of it. Throws a sentence for people if there is not exactly one model.
 */
export function modelFirst(files) {
  const models = files.filter(({ path }) => MODEL.test(path));
  if (models.length === 0) throw new Error("None of these files is a .glb, .gltf or .zip.");
  if (models.length > 1) {
    throw new Error(
      `There are ${models.length} models here (${models.map(({ path }) => path).join(", ")}): choose one.`,
    );
  }
  const [model] = models;
  if (!/\.gltf$/i.test(model.path)) return [{ file: model.file, path: model.file.name }];
  const folder = model.path.slice(0, model.path.length - model.file.name.length);
  const parts = files.filter((entry) => entry !== model && entry.path.startsWith(folder));
  return [model, ...parts].map(({ file, path }) => ({ file, path: path.slice(folder.length) }));
}

export class DropZone {
  /** `page` shows `.dragging` while files hover; `inputs`: file inputs; `onFiles([{file, path}])`. */
  constructor(page, inputs, onFiles) {
    let depth = 0;
    const hover = (change) => {
      depth = Math.max(0, depth + change);
      page.classList.toggle("dragging", depth > 0);
    };
    const files = (event) => event.dataTransfer?.types.includes("Files");
    page.addEventListener("dragenter", (event) => files(event) && hover(1));
    page.addEventListener("dragleave", (event) => files(event) && hover(-1));
    page.addEventListener("dragover", (event) => files(event) && event.preventDefault());
    page.addEventListener("drop", async (event) => {
      if (!files(event)) return;
      event.preventDefault();
      hover(-depth);
      onFiles(await droppedFiles(event.dataTransfer));
    });
    for (const input of inputs) {
      input.addEventListener("change", () => {
        const chosen = [...input.files].map((file) => ({ file, path: file.webkitRelativePath || file.name }));
        input.value = "";
        if (chosen.length > 0) onFiles(chosen);
      });
    }
  }
}
