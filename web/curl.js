// The curl command that makes the picture on screen.

/** A word for a POSIX shell. */
function shellWord(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

/** A part `name=@path` of `curl -F`. A path with characters that curl would read as syntax is quoted for curl. */
function filePart(name, path) {
  const quote = (text) => (/[";,\\]/.test(text) ? `"${text.replace(/["\\]/g, "\\$&")}"` : text);
  const named = path.includes("/") ? `;filename=${quote(path)}` : "";
  return `-F ${shellWord(`${name}=@${quote(path)}${named}`)}`;
}

/**
 * `files`: paths of the scene's files, the model first; `images`: `{id, name}` of the environment's file and the surfaces' maps;
 * `params`: as requested, with these named by id.
 */
export function curlCommand({ origin, files, images, params }) {
  const names = new Map(images.map(({ id, name }) => [id, name]));
  const named = JSON.stringify(params, (_, value) => names.get(value) ?? value);
  const stem = files[0]
    .split("/")
    .pop()
    .replace(/\.[^.]*$/, "");
  return [
    `curl ${files.map((path) => filePart("scene", path)).join(" ")}`,
    ...[...new Set(names.values())].map((name) => filePart("image", name)),
    `-F ${shellWord(`params=${named}`)}`,
    shellWord(`${origin}/v1/render`),
    `-o ${shellWord(`${stem}.png`)}`,
  ].join(" \\\n  ");
}
