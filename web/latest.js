// Latest wins: of all the pictures asked for, the newest is rendered and an older one never covers a newer one.

import { Problem, cancelJob, createJob, fetchResult, followJob, getJob } from "./api.js";

/** Waits between tries grow twofold from what the server asks for, or from this, up to the longest. */
const RETRY_S = 2;
const LONGEST_RETRY_S = 60;
const MOST_TRIES = 6;
const DRAFT_PRIORITY = 50;
/** A job that has not begun for so long is asked for its place in the queue. */
const QUEUE_MS = 1500;

/**
 * `show` is told what happens: `picture(blob)` for every picture worth showing (it may answer a promise), and of the
 * full-quality job `accepted()`, `queued(before)`, `started({device})`, `progress(progress)`, `connected(whether)` to the server,
 * `done(id, report, blob, cached)`, `cancelled()`, `failed(problem)` and `waiting(problem, seconds, tries, most)` before it is tried
 * again; of a draft only `drafted(report)` and `draftFailed(problem)`.
 */
export class LatestJob {
  #show;
  /** The wish that runs for full quality, and the draft under way. */
  #final = null;
  #draft = null;
  #nextDraft = null;
  #counter = 0;
  #shown = 0;

  constructor(show) {
    this.#show = show;
  }

  /** A quick picture. While one is under way the newest wish waits for it, so that a moving hand sees every picture. */
  draft(scene, params) {
    this.#drop(this.#final);
    this.#final = null;
    if (this.#draft) {
      this.#nextDraft = { scene, params };
    } else {
      this.#draft = this.#start(scene, params, true);
    }
  }

  /** The whole picture; a former one is cancelled. */
  final(scene, params) {
    this.#drop(this.#final);
    this.#nextDraft = null;
    this.#final = this.#start(scene, params, false);
  }

  /** Ends all that is under way; answers whether there was something. */
  cancel() {
    const wishes = [this.#final, this.#draft].filter((wish) => wish);
    this.#final = this.#draft = this.#nextDraft = null;
    for (const wish of wishes) this.#drop(wish);
    return wishes.length > 0;
  }

  #drop(wish) {
    if (!wish) return;
    wish.dropped = true;
    wish.stop?.();
    clearTimeout(wish.retry);
    this.#unwatch(wish);
    if (wish.id) cancelJob(wish.id);
  }

  #start(scene, params, draft) {
    this.#counter += 1;
    const wish = { scene, params, draft, order: this.#counter, tries: 0, dropped: false };
    this.#post(wish);
    return wish;
  }

  async #post(wish) {
    wish.tries += 1;
    try {
      const job = await createJob(wish.scene, wish.params, wish.draft ? DRAFT_PRIORITY : 0);
      wish.id = job.id;
      if (wish.dropped) {
        cancelJob(job.id);
        return;
      }
      if (!wish.draft) {
        this.#show.accepted();
        wish.watch = setTimeout(() => this.#watchQueue(wish), QUEUE_MS);
      }
      this.#follow(wish);
    } catch (problem) {
      this.#fail(wish, problem);
    }
  }

  #follow(wish) {
    wish.stop = followJob(wish.id, (name, data) => this.#event(wish, name, data));
  }

  /** Tells again and again how many jobs are before one that waits. */
  async #watchQueue(wish) {
    const watched = wish.watch;
    const job = document.hidden ? null : await getJob(wish.id).catch(() => null);
    if (wish.watch !== watched) return;
    if (job?.state === "queued") this.#show.queued(job.queue_position);
    wish.watch = setTimeout(() => this.#watchQueue(wish), QUEUE_MS);
  }

  #event(wish, name, data) {
    if (wish.dropped) return;
    if (name !== "broken" && name !== "mended") this.#unwatch(wish);
    if (!wish.draft) this.#news(wish, name, data);
    if (name === "completed") this.#complete(wish, data.report, data.cached);
    if (name === "failed") this.#fail(wish, new Problem(data));
    if (name === "cancelled") this.#end(wish, () => this.#show.cancelled());
    if (name === "lost") this.#recover(wish);
  }

  /** Of a whole picture under way. */
  #news(wish, name, data) {
    if (name === "broken") this.#show.connected(false);
    if (name === "mended") this.#show.connected(true);
    if (name === "started") this.#show.started(data);
    if (name === "progress") this.#show.progress(data);
    if (name === "preview") this.#preview(wish, data);
  }

  async #preview(wish, { url }) {
    const reply = await fetch(url).catch(() => null);
    const blob = reply?.ok && (await reply.blob());
    if (blob && !wish.complete) this.#reveal(wish, blob);
  }

  async #complete(wish, report, cached) {
    try {
      const blob = await fetchResult(wish.id);
      if (wish.dropped) return;
      wish.complete = true;
      await this.#reveal(wish, blob);
      if (wish.dropped) return;
      if (wish.draft) this.#show.drafted(report);
      this.#end(wish, () => this.#show.done(wish.id, report, blob, cached));
    } catch (problem) {
      this.#fail(wish, problem);
    }
  }

  /** The event stream broke for good: perhaps the job has ended all the same. */
  async #recover(wish) {
    try {
      const job = await getJob(wish.id);
      if (wish.dropped) return;
      if (job.state === "succeeded") await this.#complete(wish, job.report);
      else if (job.state === "failed") this.#fail(wish, new Problem(job.problem));
      else if (job.state === "cancelled") this.#end(wish, () => this.#show.cancelled());
      else wish.retry = setTimeout(() => this.#follow(wish), RETRY_S * 1000);
    } catch (problem) {
      this.#fail(wish, problem);
    }
  }

  async #reveal(wish, blob) {
    if (wish.dropped || wish.order < this.#shown) return;
    this.#shown = wish.order;
    await this.#show.picture(blob);
  }

  #unwatch(wish) {
    clearTimeout(wish.watch);
    wish.watch = null;
  }

  #fail(wish, problem) {
    if (wish.dropped) return;
    if (problem.status === 503 && !wish.draft && wish.tries < MOST_TRIES) {
      const seconds = Math.min((problem.retryAfter ?? RETRY_S) * 2 ** (wish.tries - 1), LONGEST_RETRY_S);
      this.#show.waiting(problem, seconds, wish.tries, MOST_TRIES);
      wish.retry = setTimeout(() => this.#post(wish), seconds * 1000);
      return;
    }
    if (wish.draft) this.#show.draftFailed(problem);
    this.#end(wish, () => this.#show.failed(problem));
  }

  /** Frees the wish's place; tells of a draft's end only by going on with the next. */
  #end(wish, tell) {
    if (wish.draft) {
      this.#draft = null;
      const next = this.#nextDraft;
      this.#nextDraft = null;
      if (next) this.#draft = this.#start(next.scene, next.params, true);
      return;
    }
    this.#final = null;
    tell();
  }
}
