// The controller: holds what the widgets show, and asks for a picture whenever it changes.

import { denoiser, fetchResult, renderOnce, uploadImage, uploadScene } from "./api.js";
import { curlCommand } from "./curl.js";
import { DEMO_ENVIRONMENT, demoFile } from "./demo.js";
import { LatestJob } from "./latest.js";
import { Orbit } from "./math/orbit.js";
import { START, draftParams, previewParams, requestParams } from "./params.js";
import { CameraPanel } from "./ui/camera-panel.js";
import { Comparison } from "./ui/comparison.js";
import { DropZone, modelFirst } from "./ui/drop-zone.js";
import { EnvironmentPanel } from "./ui/environment-panel.js";
import { ExportBar, save } from "./ui/export-bar.js";
import { LightList } from "./ui/light-list.js";
import { MotionPanel } from "./ui/motion-panel.js";
import { Notices } from "./ui/notices.js";
import { SettingsPanel } from "./ui/settings-panel.js";
import { StatusBar } from "./ui/status-bar.js";
import { overrideList, sphereList } from "./ui/surface-list.js";
import { Viewport } from "./ui/viewport.js";

/** A hand that is still for so long rests: time for full quality. */
const REST_MS = 350;

const byId = (id) => document.getElementById(id);

class Controller {
  #rest = null;
  #opening = 0;
  #sentAgain = false;

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
    window.addEventListener("pagehide", () => this.job.cancel());
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
    const hdri = files.length === 1 && /\.(hdr|exr)$/i.test(files[0].path);
    if (hdri) {
      this.#openHdri(files[0].file);
      return;
    }
    try {
      this.#open(modelFirst(files));
    } catch (error) {
      this.notices.error(error);
    }
  }

  async #open(files, { environment, demo = false } = {}) {
    this.#opening += 1;
    const mine = this.#opening;
    const goBack = this.#startReading(files[0].path);
    try {
      const scene = await uploadScene(files);
      if (mine !== this.#opening) return;
      this.#show(scene, files, environment);
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
    this.camera.open(scene, Orbit.framing(scene.bounds, this.#aspect()));
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
      zoom: (factor) => move((orbit) => orbit.zoomed(factor)),
      frame: () => this.#frame(),
    };
  }

  #frame() {
    if (!this.scene) return;
    const { azimuth, elevation, yfov } = this.camera.orbit;
    this.camera.orbit = Orbit.framing(this.scene.bounds, this.#aspect(), { azimuth, elevation, yfov });
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
    this.exports.ready = false;
    clearTimeout(this.#rest);
    if (!live) {
      this.job.final(this.scene.id, this.#params());
      return;
    }
    this.job.draft(this.scene.id, draftParams(this.#params(), this.settings));
    this.status.draft();
    this.#rest = setTimeout(() => this.#changed(false), REST_MS);
  }

  #params() {
    return requestParams({
      settings: this.settings,
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
      started: (news) => this.status.started(news),
      progress: (progress) => this.status.progress(progress),
      picture: (blob) => this.viewport.show(blob, `Render of ${this.files[0].path}`),
      done: (id, report, blob) => this.#done(id, report, blob),
      cancelled: () => this.status.say("Cancelled"),
      failed: (problem) => this.#failed(problem),
      drafted: (report) => this.status.drafted(report),
      // Perhaps there is no graphics driver to draw previews with; what is traced needs none.
      draftFailed: () => this.#traceDrafts(),
      waiting: (problem, seconds, tries, most) => this.status.waiting(problem.title, seconds, tries, most),
    };
  }

  #done(id, report, blob) {
    this.#sentAgain = false;
    this.finished = { id, blob };
    this.exports.ready = true;
    this.notices.clearError();
    this.status.done(report);
    this.notices.report(report);
  }

  /** A server that forgot the scene (a restart, or too many scenes) gets it once more. */
  async #failed(problem) {
    const forgotten = problem.code === "scene_not_found" && !this.#sentAgain;
    this.#sentAgain = forgotten;
    try {
      if (!forgotten) throw problem;
      await uploadScene(this.files);
      this.#changed(false);
    } catch (reason) {
      this.status.say("Failed");
      this.notices.error(reason);
    }
  }

  #cancel() {
    clearTimeout(this.#rest);
    if (this.job.cancel()) this.status.say("Cancelled");
  }

  async #openHdri(file) {
    const goBack = this.#startReading(file.name);
    try {
      this.environment.hdri = { id: await uploadImage(file), name: file.name };
    } catch (problem) {
      goBack(problem);
    }
  }

  /** Answers what a surface's card shows of it. */
  async #uploadMap(file) {
    const goBack = this.#startReading(file.name);
    try {
      return { id: await uploadImage(file), name: file.name };
    } catch (problem) {
      goBack(problem);
      return undefined;
    }
  }

  #traceDrafts() {
    this.settings = { ...this.settings, moving: "traced" };
    document.querySelector("[data-setting=moving] select").value = "traced";
  }

  #compare() {
    const params = previewParams(this.#params(), this.settings);
    this.comparison.open(this.finished.blob, renderOnce(this.scene.id, params));
  }

  #stem() {
    return this.files[0].path
      .split("/")
      .pop()
      .replace(/\.[^.]*$/, "");
  }

  async #saveExr() {
    try {
      save(await fetchResult(this.finished.id, "image/x-exr"), `${this.#stem()}.exr`);
    } catch (problem) {
      this.notices.error(problem);
    }
  }

  #curl() {
    const { kind, hdri } = this.environment.environment;
    const surfaces = [...this.spheres.items, ...this.overrides.items].filter(({ on }) => on);
    const maps = surfaces.flatMap(({ texture, detail, relief }) => [texture, detail === "none" ? null : relief]);
    return curlCommand({
      origin: window.location.origin,
      files: this.files.map(({ path }) => path),
      images: [kind === "hdri" ? hdri : null, ...maps].filter((image) => image),
      params: this.#params(),
    });
  }
}

new Controller().openDemo();
