"""The generated client for Python: a scene goes up, two pictures come back, and a fault is told as one."""

import struct
import sys
import time

from candela_client.api.jobs import create_job, delete_job, get_job, get_result
from candela_client.api.render import render
from candela_client.api.scenes import create_scene
from candela_client.client import Client
from candela_client.models import CreateSceneFilesBody, NewJob, Problem, RenderFilesBody, RenderParams
from candela_client.types import File

root, scene_file = sys.argv[1:]
client = Client(base_url=root)
params = RenderParams(width=48, height=32, max_samples=8)


def size(png):
    assert png[:8] == b"\x89PNG\r\n\x1a\n", png[:40]
    return struct.unpack(">II", png[16:24])


with open(scene_file, "rb") as file:
    scene = create_scene.sync(client=client, body=CreateSceneFilesBody(scene=File(file, "grid.glb")))
job = create_job.sync(client=client, body=NewJob(scene=scene.id, params=params))
while job.state in ("queued", "running"):
    time.sleep(0.05)
    job = get_job.sync(job.id, client=client)
assert job.state == "succeeded", job
picture = get_result.sync(job.id, client=client).payload.read()
assert size(picture) == (48, 32)

with open(scene_file, "rb") as file:
    at_once = render.sync(client=client, body=RenderFilesBody(scene=File(file, "grid.glb"), params=params))
assert at_once.payload.read() == picture, "the same picture"

assert delete_job.sync_detailed(job.id, client=client).status_code == 204
gone = get_job.sync(job.id, client=client)
assert isinstance(gone, Problem) and gone.code == "job_not_found", gone
print("Python: rendered twice, deleted, and told of a fault")
