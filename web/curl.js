// The curl command that makes the picture on screen.

/** A word for a POSIX shell. */
function shellWord(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

/** A part `name=@path` of `curl -F`. A path with characters that curl would read as syntax is quoted for curl. */
function filePart(name, path, filename = path) {
  const quote = (text) => (/[";,\\]/.test(text) ? `"${text.replace(/["\\]/g, "\\$&")}"` : text);
  const named = path.includes("/") || filename !== path ? `;filename=${quote(filename)}` : "";
  return `-F ${shellWord(`${name}=@${quote(path)}${named}`)}`;
}

/**
 * `files`: paths of the scene's files, the model first; `images`: `{id, name}` of the environment's file and the surfaces' maps;
 * `params`: as requested, with these named by id.
 */
export function curlCommand({ origin, files, images, params }) {
  const paths = new Map(images.map(({ id, name }) => [id, name]));
  // Of two files of one name, which lie in different folders, the later one is sent under another name.
  const first = new Map([...paths].reverse().map(([id, name]) => [name, id]));
  const names = new Map([...paths].map(([id, name]) => [id, first.get(name) === id ? name : `${id}-${name}`]));
  const named = JSON.stringify(params, (_, value) => names.get(value) ?? value);
  const stem = files[0]
    .split("/")
    .pop()
    .replace(/\.[^.]*$/, "");
  return [
    `curl ${files.map((path) => filePart("scene", path)).join(" ")}`,
    ...[...names].map(([id, name]) => filePart("image", paths.get(id), name)),
    // curl ends a value of -F at a semicolon.
    `--form-string ${shellWord(`params=${named}`)}`,
    shellWord(`${origin}/v1/render`),
    `-o ${shellWord(`${stem}.png`)}`,
  ].join(" \\\n  ");
}
