// The traced picture beside the rasterised one, and how they differ.

/** What the difference is multiplied by to be seen. */
const GAIN = 4;

async function pixels(blob) {
  const bitmap = await createImageBitmap(blob);
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0);
  return context.getImageData(0, 0, bitmap.width, bitmap.height);
}

/** The difference of two pictures of one size, brightened, and its mean over pixels and colours, of 255. */
function difference(a, b) {
  const shown = new ImageData(a.width, a.height);
  let sum = 0;
  for (let i = 0; i < a.data.length; i += 1) {
    const alpha = i % 4 === 3;
    const by = alpha ? 0 : Math.abs(a.data[i] - b.data[i]);
    shown.data[i] = alpha ? 255 : by * GAIN;
    sum += by;
  }
  return { shown, mean: sum / (0.75 * a.data.length) };
}

export class Comparison {
  #urls = [];
  #opened = 0;

  /** `dialog` holds a line of words, two images and a canvas. */
  constructor(dialog) {
    this.dialog = dialog;
    this.words = dialog.querySelector("[role=status]");
    this.images = [...dialog.querySelectorAll("img")];
    this.canvas = dialog.querySelector("canvas");
    dialog.querySelector(".close").addEventListener("click", () => dialog.close());
    dialog.addEventListener("close", () => this.#forget());
  }

  /** Opens with one picture; the other is a promise of a Blob of the same size. `remark`: a sentence on the latter. */
  async open(traced, preview, remark) {
    this.#forget();
    this.#opened += 1;
    const mine = this.#opened;
    const gone = () => mine !== this.#opened || !this.dialog.open;
    this.#show(0, traced);
    this.words.textContent = "Drawing the preview";
    this.dialog.showModal();
    try {
      const rasterised = await preview;
      if (gone()) return;
      this.#show(1, rasterised);
      const { shown, mean } = difference(await pixels(traced), await pixels(rasterised));
      if (gone()) return;
      Object.assign(this.canvas, { width: shown.width, height: shown.height });
      this.canvas.getContext("2d").putImageData(shown, 0, 0);
      this.words.textContent = `They differ by ${mean.toFixed(1)} of 255 on average. ${remark}`;
    } catch (problem) {
      if (!gone()) this.words.textContent = `There is no preview: ${problem.message}`;
    }
  }

  #show(index, blob) {
    const url = URL.createObjectURL(blob);
    this.#urls.push(url);
    this.images[index].src = url;
  }

  #forget() {
    for (const url of this.#urls) URL.revokeObjectURL(url);
    this.#urls = [];
    for (const image of this.images) image.removeAttribute("src");
    this.canvas.width = 0;
  }
}
