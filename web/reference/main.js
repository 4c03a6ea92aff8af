// Draws /openapi.json: routes by tag, then the shapes that they name. Text goes in as text, never as markup.

import { el } from "/ui/dom.js";

const METHODS = ["get", "post", "put", "delete"];

const anchor = (text) => text.toLowerCase().replace(/[^a-z0-9]+/g, "-");
const nameOf = (reference) => reference.split("/").pop();

/** A text whose stretches between backticks are code. */
function prose(text, tag = "p") {
  const stretches = text.split("`").map((stretch, n) => (n % 2 ? el("code", {}, stretch) : stretch));
  return el(tag, {}, ...stretches);
}

const paragraphs = (text = "") => text.split(/\n\n+/).filter((part) => part.trim()).map((part) => prose(part.trim()));

// Reached by keys, for it may be wider than the page.
const block = (value) => el("pre", { tabindex: "0" }, typeof value === "string" ? value : JSON.stringify(value, null, 2));

class Reference {
  constructor(contract) {
    this.contract = contract;
  }

  /** What a reference leads to, or the thing itself. */
  resolve(thing) {
    if (!thing.$ref) return thing;
    return thing.$ref.slice(2).split("/").reduce((at, step) => at[step], this.contract);
  }

  /** A schema in a few words, with links to those that have a name. */
  words(schema) {
    if (schema.$ref) {
      const name = nameOf(schema.$ref);
      return el("a", { href: `#schema-${anchor(name)}` }, name);
    }
    const options = schema.anyOf ?? schema.oneOf;
    if (options) return el("span", {}, ...options.flatMap((option, n) => [n ? " or " : null, this.words(option)]));
    if (schema.enum) return el("span", {}, schema.enum.map((value) => JSON.stringify(value)).join(", "));
    if (schema.type === "array") return el("span", {}, "list of ", this.words(schema.items ?? {}));
    const kind = [schema.type ?? "any"].flat().join(" or ");
    const bounds = [
      schema.minimum !== undefined ? `from ${schema.minimum}` : null,
      schema.maximum !== undefined ? `to ${schema.maximum}` : null,
      schema.default !== undefined ? `by default ${JSON.stringify(schema.default)}` : null,
    ].filter(Boolean);
    return el("span", {}, [kind, ...bounds].join(", "));
  }

  /** Name, kind and meaning of each field. */
  fields(rows) {
    const cells = ({ name, required, schema, description }) =>
      el(
        "tr",
        {},
        el("td", {}, el("code", {}, name), required ? el("span", { class: "needed" }, " needed") : null),
        el("td", {}, this.words(schema)),
        prose(description ?? schema.description ?? "", "td"),
      );
    return el("div", { class: "wide" }, el("table", {}, el("tbody", {}, ...rows.map(cells))));
  }

  properties(schema) {
    const parts = (schema.allOf ?? []).map((part) => this.resolve(part));
    const rows = [schema, ...parts].flatMap((part) =>
      Object.entries(part.properties ?? {}).map(([name, property]) => ({
        name,
        schema: property,
        required: part.required?.includes(name),
      })),
    );
    return rows.length ? this.fields(rows) : null;
  }

  content(content = {}) {
    return Object.entries(content).map(([type, { schema = {}, example }]) =>
      el(
        "div",
        { class: "content" },
        el("p", {}, el("code", {}, type), " ", this.words(schema)),
        schema.properties ? this.properties(schema) : null,
        example === undefined ? null : block(example),
      ),
    );
  }

  operation(path, method, operation, shared) {
    const parameters = [...shared, ...(operation.parameters ?? [])].map((parameter) => this.resolve(parameter));
    const rows = parameters.map(({ name, in: place, required, schema, description }) => ({
      name: `${name} (${place})`,
      required,
      schema,
      description,
    }));
    const responses = Object.entries(operation.responses).map(([status, given]) => {
      const response = this.resolve(given);
      const fault = status >= "400";
      const headers = Object.entries(response.headers ?? {}).map(([name, header]) => ({ name, ...this.resolve(header) }));
      return el(
        "details",
        { open: !fault },
        el("summary", {}, el("strong", {}, status), " ", response.description.trim()),
        headers.length ? this.fields(headers) : null,
        ...this.content(response.content),
      );
    });
    const body = operation.requestBody;
    const scope = operation.security?.find((way) => way.key)?.key[0];
    return el(
      "section",
      { id: operation.operationId, class: "operation" },
      el("h3", {}, el("span", { class: `method ${method}` }, method.toUpperCase()), " ", el("code", {}, path)),
      prose(operation.summary ?? ""),
      ...paragraphs(operation.description),
      scope ? prose(`Where the server asks for keys: one of the scope \`${scope}\` or above.`) : null,
      rows.length ? el("h4", {}, "Parameters") : null,
      rows.length ? this.fields(rows) : null,
      body ? el("h4", {}, "Body") : null,
      ...(body ? this.content(body.content) : []),
      el("h4", {}, "Replies"),
      ...responses,
    );
  }

  operations() {
    return Object.entries(this.contract.paths).flatMap(([path, item]) =>
      METHODS.filter((method) => item[method]).map((method) => ({
        tag: item[method].tags?.[0],
        id: item[method].operationId,
        label: `${method.toUpperCase()} ${path}`,
        element: this.operation(path, method, item[method], item.parameters ?? []),
      })),
    );
  }

  draw(nav, main, status) {
    const { info, tags, components } = this.contract;
    status.replaceWith(...paragraphs(info.description), el("p", {}, `Version ${info.version}. The same as `, el("a", { href: "/openapi.yaml" }, "/openapi.yaml"), "; codes of faults: ", el("a", { href: "/docs/errors" }, "/docs/errors"), "."));
    const operations = this.operations();
    for (const { name, description } of tags) {
      const own = operations.filter((operation) => operation.tag === name);
      nav.append(el("h2", {}, name), el("ul", {}, ...own.map(({ id, label }) => el("li", {}, el("a", { href: `#${id}` }, label)))));
      main.append(el("h2", {}, name), prose(description ?? ""), ...own.map(({ element }) => element));
    }
    main.append(el("h2", {}, "Shapes"));
    const schemas = Object.entries(components.schemas);
    nav.append(el("h2", {}, "Shapes"), el("ul", {}, ...schemas.map(([name]) => el("li", {}, el("a", { href: `#schema-${anchor(name)}` }, name)))));
    for (const [name, schema] of schemas) {
      const kind = schema.properties || schema.allOf ? null : el("p", {}, this.words(schema));
      main.append(
        el("section", { id: `schema-${anchor(name)}` }, el("h3", {}, name), ...paragraphs(schema.description), kind, this.properties(schema)),
      );
    }
    // The element that the address names has only now come to be.
    document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
  }
}

const status = document.getElementById("status");
try {
  const response = await fetch("/openapi.json");
  if (!response.ok) throw new Error(`the server answered ${response.status}`);
  new Reference(await response.json()).draw(document.querySelector("nav"), document.querySelector("main"), status);
} catch (error) {
  status.replaceWith(prose(`The reference cannot be drawn: ${error.message}. The contract by itself is at \`/openapi.yaml\`.`));
}
