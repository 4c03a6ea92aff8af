// The controller: holds what the widgets show, and asks for a picture whenever it changes.

import { fetchResult, uploadImage, uploadScene } from "./api.js";
import { curlCommand } from "./curl.js";
import { DEMO_ENVIRONMENT, demoFile } from "./demo.js";
import { LatestJob } from "./latest.js";
import { Orbit } from "./math/orbit.js";
import { START, draftParams, requestParams } from "./params.js";
import { CameraPanel } from "./ui/camera-panel.js";
import { DropZone, modelFirst } from "./ui/drop-zone.js";
import { EnvironmentPanel } from "./ui/environment-panel.js";
import { ExportBar, save } from "./ui/export-bar.js";
import { LightList } from "./ui/light-list.js";
import { Notices } from "./ui/notices.js";
import { SettingsPanel } from "./ui/settings-panel.js";
import { StatusBar } from "./ui/status-bar.js";
import { Viewport } from "./ui/viewport.js";

/** A hand that is still for so long rests: time for full quality. */
const REST_MS = 350;

const byId = (id) => document.getElementById(id);

class Controller {
  #rest = null;
  #opening = 0;

  constructor() {
    this.settings = START;
    this.scene = null;
    this.files = [];
    this.finished = null;
    this.job = new LatestJob(this.#jobListener());
    this.notices = new Notices(byId("alert"), byId("notes"));
    this.status = new StatusBar(byId("status"), () => this.#cancel());
    this.viewport = new Viewport(byId("viewport"), this.#hand());
    this.camera = new CameraPanel(byId("camera"), (_, live) => this.#changed(live), () => this.#frame());
    this.lights = new LightList(byId("lights"), (_, scene_lights, live) => this.#set({ scene_lights }, live));
    this.environment = new EnvironmentPanel(byId("environment"), (_, live) => this.#changed(live), (file) => this.#openHdri(file));
    for (const panel of ["look", "quality", "picture"]) {
      new SettingsPanel(byId(panel), panel, START, (changes, live) => this.#set(changes, live));
    }
    this.exports = new ExportBar(byId("exports"), {
      png: () => save(this.finished.blob, `${this.#stem()}.png`),
      exr: () => this.#saveExr(),
      curl: () => this.#curl(),
    });
    new DropZone(document.body, [byId("choose-files"), byId("choose-folder")], (files) => this.#drop(files));
    byId("save-model").addEventListener("click", () => save(this.files[0].file, this.files[0].path));
    this.viewport.aspect = START.width / START.height;
  }

  /** The first picture, before the visitor does anything. */
  openDemo() {
    const file = demoFile();
    return this.#open([{ file, path: file.name }], { environment: DEMO_ENVIRONMENT, demo: true });
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
    this.job.cancel();
    this.notices.clearError();
    this.status.say(`Reading ${files[0].path}`, { busy: true });
    try {
      const scene = await uploadScene(files);
      if (mine !== this.#opening) return;
      this.#show(scene, files, environment);
      byId("save-model").hidden = !demo;
      document.body.classList.toggle("welcome", demo);
    } catch (problem) {
      if (mine !== this.#opening) return;
      this.notices.error(problem);
      this.status.say(this.scene ? "The former model stays" : "No model");
    }
  }

  #show(scene, files, environment) {
    this.scene = scene;
    this.files = files;
    byId("model-name").textContent = files[0].path;
    this.camera.open(scene, this.#firstOrbit(scene));
    this.lights.open(scene);
    this.environment.open(environment);
    this.settings = { ...this.settings, scene_lights: true };
    this.exports.nameable = true;
    this.notices.report({ warnings: scene.warnings });
    this.#changed(false);
  }

  #aspect() {
    return this.settings.width / this.settings.height;
  }

  /** Continues the file's first camera, or frames the scene. */
  #firstOrbit(scene) {
    const first = scene.cameras[0];
    return first?.position
      ? Orbit.fromCamera({ ...first, yfov: first.yfov_degrees ?? 45 }, scene.bounds)
      : Orbit.framing(scene.bounds, this.#aspect());
  }

  #hand() {
    const move = (by) => {
      if (!this.scene) return;
      this.camera.orbit = by(this.#currentOrbit());
      this.#changed(true);
    };
    return {
      turn: (dx, dy) => move((orbit) => orbit.turned(dx, dy)),
      pan: (dx, dy) => move((orbit) => orbit.panned(dx, dy)),
      zoom: (factor) => move((orbit) => orbit.zoomed(factor)),
      frame: () => this.#frame(),
    };
  }

  /** Where a free orbit begins: at the camera of the file that is shown, or where it was left. */
  #currentOrbit() {
    const { index, orbit } = this.camera.camera;
    const shown = index === null ? null : this.scene.cameras[index];
    return shown?.position ? Orbit.fromCamera({ ...shown, yfov: shown.yfov_degrees ?? 45 }, this.scene.bounds) : orbit;
  }

  #frame() {
    if (!this.scene) return;
    const { azimuth, elevation, yfov } = this.#currentOrbit();
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
    this.job.draft(this.scene.id, draftParams(this.#params()));
    this.status.say("Draft");
    this.#rest = setTimeout(() => this.#changed(false), REST_MS);
  }

  #params() {
    return requestParams({
      settings: this.settings,
      camera: this.camera.camera,
      lights: this.lights.lights,
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
      failed: (problem) => {
        this.status.say("Failed");
        this.notices.error(problem);
      },
      busy: (seconds) => this.status.say(`The server is busy: trying again in ${seconds} s`, { busy: true }),
    };
  }

  #done(id, report, blob) {
    this.finished = { id, blob };
    this.exports.ready = true;
    this.notices.clearError();
    this.status.done(report);
    this.notices.report(report);
  }

  #cancel() {
    clearTimeout(this.#rest);
    if (this.job.cancel()) this.status.say("Cancelled");
  }

  async #openHdri(file) {
    this.status.say(`Reading ${file.name}`, { busy: true });
    try {
      this.environment.hdri = { id: await uploadImage(file), name: file.name };
    } catch (problem) {
      this.notices.error(problem);
      this.status.say("The former environment stays");
    }
  }

  #stem() {
    return this.files[0].path.split("/").pop().replace(/\.[^.]*$/, "");
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
    return curlCommand({
      origin: window.location.origin,
      files: this.files.map(({ path }) => path),
      hdri: kind === "hdri" && hdri ? hdri.name : null,
      params: this.#params(),
    });
  }
}

new Controller().openDemo();
