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
 * `files`: paths of the scene's files, the model first; `hdri`: name of the environment's file, if it has one;
 * `params`: as requested, with the environment named by id.
 */
export function curlCommand({ origin, files, hdri, params }) {
  const named = hdri ? { ...params, environment: { ...params.environment, hdri } } : params;
  const stem = files[0]
    .split("/")
    .pop()
    .replace(/\.[^.]*$/, "");
  return [
    `curl ${files.map((path) => filePart("scene", path)).join(" ")}`,
    ...(hdri ? [filePart("image", hdri)] : []),
    `-F ${shellWord(`params=${JSON.stringify(named)}`)}`,
    shellWord(`${origin}/v1/render`),
    `-o ${shellWord(`${stem}.png`)}`,
  ].join(" \\\n  ");
}
