// The controller: holds what the widgets show, and asks for a picture whenever it changes.

import { denoiser, fetchResult, renderOnce, uploadImage, uploadScene } from "./api.js";
import { curlCommand } from "./curl.js";
import { DEMO_ENVIRONMENT, demoFile } from "./demo.js";
import { LatestJob } from "./latest.js";
import { Orbit, boundingSphere } from "./math/orbit.js";
import { START, draftParams, previewParams, requestParams } from "./params.js";
import { PreviewLight } from "./preview-light.js";
import { CameraPanel } from "./ui/camera-panel.js";
import { Comparison } from "./ui/comparison.js";
import { DropZone, modelFirst, withoutHdris } from "./ui/drop-zone.js";
import { EnvironmentPanel } from "./ui/environment-panel.js";
import { ExportBar, save } from "./ui/export-bar.js";
import { LightList } from "./ui/light-list.js";
import { ModelPanel } from "./ui/model-panel.js";
import { MotionPanel } from "./ui/motion-panel.js";
import { Notices } from "./ui/notices.js";
import { SettingsPanel } from "./ui/settings-panel.js";
import { StatusBar } from "./ui/status-bar.js";
import { overrideList, sphereList } from "./ui/surface-list.js";
import { Viewport } from "./ui/viewport.js";

const EXR = "image/x-exr";

/** A hand that is still for so long rests: time for full quality. */
const REST_MS = 350;

/** What a server says that has nothing to render with, and what a finished job's full picture may be lost to. */
const NO_DEVICE = "device_unavailable";
const NO_LINEAR_PICTURE = ["job_not_found", "linear_picture_gone"];

const NO_PREVIEWS = {
  detail: "This server has no graphics driver to draw previews with: “While moving” is now a few traced samples.",
};
const STAND_IN = "Surfaces that emit light nothing in a preview: a neutral sky stands in for them.";

const byId = (id) => document.getElementById(id);

class Controller {
  #rest = null;
  #opening = 0;
  #sentAgain = false;
  /** Whether the last draft failed for want of a graphics driver, and whether drafts are traced for that reason. */
  #undrawn = false;
  #noPreviews = false;
  #light = new PreviewLight();
  #interrupted = false;

  constructor() {
    this.settings = START;
    this.scene = null;
    this.files = [];
    this.finished = null;
    this.job = new LatestJob(this.#jobListener());
    this.notices = new Notices(byId("alert"), byId("notes"));
    this.status = new StatusBar(byId("status"), () => this.#cancel());
    this.viewport = new Viewport(byId("viewport"), this.#hand());
    this.camera = new CameraPanel(
      byId("camera"),
      (live) => this.#changed(live),
      () => this.#frame(),
    );
    this.model = new ModelPanel(byId("model-section"), byId("model"), (isOtherScene) => this.#remodel(isOtherScene));
    this.motion = new MotionPanel(byId("motion-section"), byId("motion"), (live) => this.#changed(live));
    this.lights = new LightList(byId("lights"), (sceneLights, live) => this.#set({ scene_lights: sceneLights }, live));
    const surfaceChanged = (live) => this.#changed(live);
    const map = (file) => this.#uploadMap(file);
    this.spheres = sphereList(byId("spheres"), surfaceChanged, map);
    this.overrides = overrideList(byId("materials"), surfaceChanged, map);
    this.environment = new EnvironmentPanel(
      byId("environment"),
      (live) => this.#changed(live),
      (file) => this.#openHdri(file),
    );
    const settings = (panel) =>
      new SettingsPanel(byId(panel), panel, START, (changes, live) => this.#set(changes, live));
    const [, quality] = ["look", "quality", "preview", "picture"].map(settings);
    this.#offerDenoising(quality);
    this.exports = new ExportBar(byId("exports"), {
      png: () => save(this.finished.blob, `${this.#stem()}.png`),
      exr: () => this.#saveExr(),
      compare: () => this.#compare(),
      curl: () => this.#curl(),
    });
    this.comparison = new Comparison(byId("comparison"));
    new DropZone(document.body, [byId("choose-files"), byId("choose-folder")], (files) => this.#drop(files));
    byId("save-model").addEventListener("click", () => save(this.files[0].file, this.files[0].path));
    window.addEventListener("pagehide", () => {
      this.#interrupted = this.job.cancel();
    });
    window.addEventListener("pageshow", () => this.#interrupted && this.#changed(false));
    this.viewport.aspect = this.#aspect();
  }

  /** The first picture, before the visitor does anything. */
  openDemo() {
    const file = demoFile();
    return this.#open([{ file, path: file.name }], { environment: DEMO_ENVIRONMENT, demo: true });
  }

  async #offerDenoising(panel) {
    // A server that does not answer says so when it is asked for a picture.
    if (await denoiser().catch(() => null)) panel.offer("denoise");
  }

  #drop(files) {
    const { hdris, others } = withoutHdris(files);
    const hdri = hdris.length === 1 ? hdris[0].file : null;
    try {
      if (others.length > 0) this.#open(modelFirst(others), { hdri });
      else if (hdri) this.#openHdri(hdri);
      if (hdris.length > 1) {
        throw new Error(`There are ${hdris.length} HDRIs here (${hdris.map(({ path }) => path).join(", ")}): open one of them.`);
      }
    } catch (error) {
      this.notices.error(error);
    }
  }

  async #open(files, { environment, hdri, demo = false } = {}) {
    this.#opening += 1;
    const mine = this.#opening;
    const goBack = this.#startReading(files[0].path);
    try {
      const [scene, image] = await Promise.all([uploadScene(files), hdri && uploadImage(hdri)]);
      if (mine !== this.#opening) return;
      this.#show(scene, files, image ? { kind: "hdri", hdri: image } : environment);
      byId("save-model").hidden = !demo;
      document.body.classList.toggle("welcome", demo);
    } catch (problem) {
      if (mine === this.#opening) goBack(problem);
    }
  }

  /** The picture under way goes on while a file is read; answers what to do if that fails. */
  #startReading(name) {
    this.notices.clearError();
    const takeBack = this.status.aside(`Reading ${name}`);
    return (problem) => {
      this.notices.error(problem);
      takeBack(this.scene ? `${name} was not opened` : "No model");
    };
  }

  #show(scene, files, environment) {
    this.scene = scene;
    this.files = files;
    byId("model-name").textContent = files[0].path;
    document.title = `${files[0].path} – Candela`;
    this.model.open(scene);
    this.#openCamera();
    this.motion.open(scene);
    this.lights.open(scene);
    this.spheres.open(scene);
    this.overrides.open(scene);
    this.environment.open(environment);
    this.settings = { ...this.settings, scene_lights: true };
    this.exports.nameable = true;
    this.notices.report({ warnings: scene.warnings });
    this.#changed(false);
  }

  /** Of another scene of the file than its default one the server describes neither bounds nor cameras: it frames what is there. */
  #openCamera() {
    const framed = this.model.model.scene !== null;
    const shown = framed ? { ...this.scene, cameras: [] } : this.scene;
    this.camera.open(shown, Orbit.framing(this.scene.bounds, this.#aspect(), { framed }));
  }

  #remodel(isOtherScene) {
    if (isOtherScene) this.#openCamera();
    this.#changed(false);
  }

  #aspect() {
    return this.settings.width / this.settings.height;
  }

  #hand() {
    const move = (by) => {
      if (!this.scene) return;
      this.camera.orbit = by(this.camera.orbit);
      this.#changed(true);
    };
    return {
      turn: (dx, dy) => move((orbit) => orbit.turned(dx, dy)),
      pan: (dx, dy) => move((orbit) => orbit.panned(dx, dy)),
      zoom: (factor) => move((orbit) => orbit.zoomed(factor, boundingSphere(this.scene.bounds).radius)),
      frame: () => this.#frame(),
    };
  }

  #frame() {
    if (!this.scene) return;
    const { azimuth, elevation, yfov } = this.camera.orbit;
    const angles = { azimuth, elevation, yfov };
    this.camera.orbit = Orbit.framing(this.scene.bounds, this.#aspect(), { ...angles, framed: true });
    this.#changed(false);
  }

  #set(changes, live) {
    this.settings = { ...this.settings, ...changes };
    this.viewport.aspect = this.#aspect();
    this.viewport.transparent = this.settings.transparent;
    this.#changed(live);
  }

  /** Something is different now: a draft while the hand moves, the whole picture when it rests. */
  #changed(live) {
    if (!this.scene) return;
    this.exports.offer(false);
    this.camera.settle();
    clearTimeout(this.#rest);
    if (!live) {
      this.job.final(this.scene.id, this.#params());
      return;
    }
    const params = this.#params();
    this.job.draft(this.scene.id, draftParams(params, this.settings, this.#light.of(this.scene, params)));
    this.status.draft();
    this.#rest = setTimeout(() => this.#changed(false), REST_MS);
  }

  #params() {
    return requestParams({
      settings: this.settings,
      model: this.model.model,
      camera: this.camera.camera,
      motion: this.motion.motion,
      lights: this.lights.lights,
      spheres: this.spheres.items,
      overrides: this.overrides.items,
      environment: this.environment.environment,
    });
  }

  #jobListener() {
    return {
      accepted: () => this.status.begin(),
      queued: (before) => this.status.queued(before),
      connected: (whether) => this.status.connected(whether),
      started: (news) => {
        this.#sentAgain = false;
        this.status.started(news);
      },
      progress: (progress) => this.status.progress(progress),
      picture: (blob) => this.viewport.show(blob, `Render of ${this.files[0].path}`),
      done: (id, report, blob, cached) => this.#done(id, report, blob, cached),
      cancelled: () => this.status.say("Cancelled"),
      failed: (problem) => this.#failed(problem),
      drafted: (report) => {
        this.#undrawn = false;
        this.status.drafted(report);
      },
      draftFailed: (problem) => {
        this.#undrawn = problem.code === NO_DEVICE;
      },
      waiting: (problem, seconds, tries, most) => this.status.waiting(problem.title, seconds, tries, most),
    };
  }

  #done(id, report, blob, cached) {
    this.#sentAgain = false;
    this.finished = { id, blob };
    this.exports.offer(true, this.settings.mode !== "preview");
    this.notices.clearError();
    this.status.done(report, cached);
    this.camera.hear(report.defaults);
    this.#light.learn(this.scene, this.#params(), report.defaults);
    // What processors have traced was no draft's fault: there is no device at all, rather than one that was lost for a while.
    if (this.#undrawn && report.engine === "cpu") this.#traceDrafts();
    const more = this.#noPreviews && this.settings.moving === "traced" ? [NO_PREVIEWS] : [];
    this.notices.report({ ...report, warnings: [...report.warnings, ...more] });
  }

  /** A server that forgot what it was sent (a restart, or too many scenes) gets it once more. */
  async #failed(problem) {
    const again = problem.isForgotten && !this.#sentAgain;
    this.#sentAgain = again;
    try {
      if (!again) throw problem;
      await this.#sendAgain();
      this.#changed(false);
    } catch (reason) {
      this.status.say("Failed");
      this.notices.error(reason);
    }
  }

  async #sendAgain() {
    await Promise.all([uploadScene(this.files), ...this.#images().map(({ file }) => uploadImage(file))]);
  }

  /** Renders beside what is on screen. */
  async #renderBeside(params, type) {
    try {
      return await renderOnce(this.scene.id, params, type);
    } catch (problem) {
      if (!problem.isForgotten) throw problem;
      await this.#sendAgain();
      return renderOnce(this.scene.id, params, type);
    }
  }

  /** Pictures that the request names, `{id, name, file}`. */
  #images() {
    const { kind, hdri } = this.environment.environment;
    const surfaces = [...this.spheres.items, ...this.overrides.items].filter(({ on }) => on);
    const maps = surfaces.flatMap(({ texture, detail, relief }) => [texture, detail === "none" ? null : relief]);
    return [kind === "hdri" ? hdri : null, ...maps].filter((image) => image);
  }

  #cancel() {
    clearTimeout(this.#rest);
    if (this.job.cancel()) this.status.say("Cancelled");
  }

  async #openHdri(file) {
    const goBack = this.#startReading(file.name);
    try {
      this.environment.hdri = await uploadImage(file);
    } catch (problem) {
      goBack(problem);
    }
  }

  /** Answers what a surface's card shows of it. */
  async #uploadMap(file) {
    const goBack = this.#startReading(file.name);
    try {
      return await uploadImage(file);
    } catch (problem) {
      goBack(problem);
      return undefined;
    }
  }

  #traceDrafts() {
    this.#undrawn = false;
    this.#noPreviews = true;
    this.settings = { ...this.settings, moving: "traced" };
    document.querySelector("[data-setting=moving] select").value = "traced";
  }

  #compare() {
    const params = this.#params();
    const light = this.#light.of(this.scene, params);
    const remark = light.environment ? STAND_IN : "";
    const preview = this.#renderBeside({ ...previewParams(params, this.settings), ...light });
    this.comparison.open(this.finished.blob, preview, remark);
  }

  #stem() {
    return this.files[0].path
      .split("/")
      .pop()
      .replace(/\.[^.]*$/, "");
  }

  async #saveExr() {
    try {
      save(await this.#exr(), `${this.#stem()}.exr`);
    } catch (problem) {
      this.notices.error(problem);
    }
  }

  /** The finished picture; rendered again if the server has forgotten it. */
  async #exr() {
    const params = this.#params();
    try {
      return await fetchResult(this.finished.id, EXR);
    } catch (problem) {
      if (!NO_LINEAR_PICTURE.includes(problem.code)) throw problem;
      const takeBack = this.status.aside("Rendering the EXR again");
      const again = { ...params, output: { ...params.output, format: "exr" } };
      return await this.#renderBeside(again, EXR).finally(() => takeBack("Done"));
    }
  }

  #curl() {
    return curlCommand({
      origin: window.location.origin,
      files: this.files.map(({ path }) => path),
      images: this.#images(),
      params: this.#params(),
    });
  }
}

new Controller().openDemo();
