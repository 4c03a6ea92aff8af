// The server's HTTP interface, and nothing else: requests out, plain objects and Problems back.

/** An error reply (problem+json), or a request that got no reply. */
export class Problem extends Error {
  constructor({ title, detail, status = 0, code, errors = [], retryAfter }) {
    super(detail ?? title);
    Object.assign(this, { title, detail, status, code, errors, retryAfter });
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
 * `{id, bounds: {min, max}, cameras: [{name, position, direction, yfov}], lights, warnings}`.
 */
export async function uploadScene(files) {
  const form = new FormData();
  for (const { file, path } of files) form.append("scene", file, path);
  const { id } = await answer("/v1/scenes", { method: "POST", body: form });
  const scene = await answer(`/v1/scenes/${id}`);
  const cameras = scene.cameras.map((camera) => ({ ...camera, yfov: camera.yfov_degrees ?? USUAL_YFOV }));
  return { ...scene, cameras, bounds: scene.bounds ?? NO_BOUNDS };
}

/** Answers the id that `environment.hdri` takes. */
export async function uploadImage(file) {
  const form = new FormData();
  form.append("image", file, file.name);
  return (await answer("/v1/images", { method: "POST", body: form })).id;
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
export async function renderOnce(scene, params) {
  const { id } = await createJob(scene, params);
  await new Promise((resolve, reject) => {
    followJob(id, (name, data) => {
      if (name === "completed") resolve();
      if (name === "failed") reject(new Problem(data));
      if (name === "cancelled" || name === "lost") reject(new Problem({ title: "The connection to the job was lost" }));
    });
  });
  return fetchResult(id);
}

const JOB_EVENTS = ["started", "progress", "preview", "completed", "failed", "cancelled"];
const LAST_EVENTS = ["completed", "failed", "cancelled"];

/**
 * Calls `on(name, data)` for each event of a job, up to the one that ends it; `on("lost")` if the stream breaks for good.
 * Answers a function that stops listening.
 */
export function followJob(id, on) {
  const source = new EventSource(`/v1/jobs/${id}/events`);
  for (const name of JOB_EVENTS) {
    source.addEventListener(name, (event) => {
      if (LAST_EVENTS.includes(name)) source.close();
      on(name, JSON.parse(event.data));
    });
  }
  source.addEventListener("error", () => {
    if (source.readyState === EventSource.CLOSED) on("lost");
  });
  return () => source.close();
}
