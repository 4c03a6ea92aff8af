// The generated client for TypeScript: a scene goes up, two pictures come back, and a fault is told as one.

import { readFileSync } from 'node:fs';
import { createJob, createScene, deleteJob, getJob, getResult, render, type Job, type RenderParams } from './client';
import { client } from './client/client.gen';

const [root, file] = process.argv.slice(2) as [string, string];
client.setConfig({ baseUrl: root });
const params: RenderParams = { width: 48, height: 32, max_samples: 8 };
const glb = () => new File([readFileSync(file)], 'grid.glb');

function check(holds: boolean, what: string): asserts holds {
    if (!holds) throw new Error(what);
}

async function bytes(picture: unknown): Promise<Buffer> {
    check(picture instanceof Blob, 'the picture is a file');
    const bytes = Buffer.from(await picture.arrayBuffer());
    check(bytes.readUInt32BE(16) === 48 && bytes.readUInt32BE(20) === 32, 'of the size that was asked for');
    return bytes;
}

async function main(): Promise<void> {
    const { data: scene } = await createScene({ body: { scene: glb() }, throwOnError: true });
    // With `Prefer: wait` it could be the picture.
    let job = (await createJob({ body: { scene: scene.id, params }, throwOnError: true })).data as Job;
    const path = { id: job.id };
    while (job.state === 'queued' || job.state === 'running') {
        await new Promise((resolve) => setTimeout(resolve, 50));
        ({ data: job } = await getJob({ path, throwOnError: true }));
    }
    check(job.state === 'succeeded', `the job is ${job.state}`);
    const picture = await bytes((await getResult({ path, parseAs: 'blob', throwOnError: true })).data);
    const body = { scene: glb(), params };
    const again = await bytes((await render({ body, parseAs: 'blob', throwOnError: true })).data);
    check(picture.equals(again), 'both pictures are the same');
    await deleteJob({ path, throwOnError: true });
    const { error } = await getJob({ path });
    check(error?.code === 'job_not_found', 'a fault is told as one');
    console.log('TypeScript: rendered twice, deleted, and told of a fault');
}

void main();
