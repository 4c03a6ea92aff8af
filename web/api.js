// The server's HTTP interface, and nothing else: requests out, plain objects and Problems back.

/** An error reply (problem+json), or a request that got no reply. */
export class Problem extends Error {
  constructor({ title, detail, status = 0, code, errors = [], retryAfter }) {
    super(detail ?? title);
    Object.assign(this, { title, detail, status, code, errors, retryAfter });
  }

  /**
   * Whether the server no longer has what it was sent before: it was restarted without a data folder, or has made room. A picture
   * that it lacks is at fault where the parameters name it.
   */
  get isForgotten() {
    const lacksImage = this.code === "invalid_params" && this.errors.some(({ pointer }) => /\/(image|hdri)$/.test(pointer ?? ""));
    return lacksImage || ["scene_not_found", "job_not_found"].includes(this.code);
  }

  static async from(response) {
    const retryAfter = Number(response.headers.get("retry-after")) || undefined;
    const said = await response.json().catch(() => ({}));
    const title = said.title ?? `The server answered ${response.status}`;
    return new Problem({ ...said, title, status: response.status, retryAfter });
  }
}

async function ask(path, options) {
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Problem({ title: "The server cannot be reached", detail: "Check that it is running, then try again." });
  }
  if (!response.ok) throw await Problem.from(response);
  return response;
}

const answer = async (path, options) => (await ask(path, options)).json();

/** What a scene without triangles is taken to fill. */
const NO_BOUNDS = { min: [-1, -1, -1], max: [1, 1, 1] };
const USUAL_YFOV = 45;

/**
 * `files`: `[{file, path}]`, where `path` is the URI that the model calls the file by. Answers
 * `{id, bounds: {min, max}, cameras: [{name, position, direction, yfov}], scenes, variants, lights, warnings}`.
 */
export async function uploadScene(files) {
  const form = new FormData();
  for (const { file, path } of files) form.append("scene", file, path);
  const { id } = await answer("/v1/scenes", { method: "POST", body: form });
  const scene = await answer(`/v1/scenes/${id}`);
  const cameras = scene.cameras.map((camera) => ({ ...camera, yfov: camera.yfov_degrees ?? USUAL_YFOV }));
  return { ...scene, cameras, bounds: scene.bounds ?? NO_BOUNDS };
}

/** Answers `{id, name, file}`; parameters name the picture by its `id`. */
export async function uploadImage(file) {
  const form = new FormData();
  form.append("image", file, file.name);
  const { id } = await answer("/v1/images", { method: "POST", body: form });
  return { id, name: file.name, file };
}

/** Answers the name of what denoises on the server; null: nothing does. */
export async function denoiser() {
  return (await answer("/v1/limits")).denoiser;
}

/** Answers the job. */
export function createJob(scene, params, priority = 0) {
  const body = JSON.stringify({ scene, params, priority });
  return answer("/v1/jobs", { method: "POST", body, headers: { "content-type": "application/json" } });
}

export function getJob(id) {
  return answer(`/v1/jobs/${id}`);
}

/** Harmless for a job that has ended. */
export function cancelJob(id) {
  return fetch(`/v1/jobs/${id}/cancel`, { method: "POST", keepalive: true }).catch(() => {});
}

/** The picture of a job that succeeded, as a Blob. */
export async function fetchResult(id, type = "image/png") {
  return (await ask(`/v1/jobs/${id}/result`, { headers: { accept: type } })).blob();
}

/** Renders a picture beside all others, and answers it as a Blob. */
export async function renderOnce(scene, params, type) {
  const { id } = await createJob(scene, params);
  await new Promise((resolve, reject) => {
    followJob(id, (name, data) => {
      if (name === "completed") resolve();
      if (name === "failed") reject(new Problem(data));
      if (name === "cancelled" || name === "lost") reject(new Problem({ title: "The connection to the job was lost" }));
    });
  });
  return fetchResult(id, type);
}

const JOB_EVENTS = ["started", "progress", "preview", "completed", "failed", "cancelled"];
const LAST_EVENTS = ["completed", "failed", "cancelled"];

/**
 * Calls `on(name, data)` for each event of a job, up to the one that ends it; `on("broken")` and `on("mended")` when the stream breaks
 * and comes back, `on("lost")` if it breaks for good. Answers a function that stops listening.
 *
 * A page that nobody sees does not listen: a browser has no more than six connections to a server, for all its tabs together. Who
 * comes back hears the job's news from the start, but of progress and pictures the newest alone.
 */
export function followJob(id, on) {
  let source = null;
  const listen = () => {
    source = openStream(id, (name, data) => {
      if (LAST_EVENTS.includes(name) || name === "lost") stop();
      on(name, data);
    });
  };
  const turn = () => {
    source?.close();
    if (!document.hidden) listen();
  };
  const stop = () => {
    document.removeEventListener("visibilitychange", turn);
    source?.close();
  };
  document.addEventListener("visibilitychange", turn);
  turn();
  return stop;
}

function openStream(id, on) {
  const source = new EventSource(`/v1/jobs/${id}/events`);
  for (const name of JOB_EVENTS) source.addEventListener(name, ({ data }) => on(name, JSON.parse(data)));
  source.addEventListener("open", () => on("mended"));
  source.addEventListener("error", () => on(source.readyState === EventSource.CLOSED ? "lost" : "broken"));
  return source;
}
