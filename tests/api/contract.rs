//! `openapi.yaml` is what the server does: the same routes, and replies of the shapes that it promises.

use crate::support::{Reply, Server, endless, tiny, triangle};
use candela::http::router::routes;
use serde_json::{Value, json};
use std::collections::BTreeSet;

fn contract() -> Value {
    Server::start().get("/openapi.json").json()
}

#[test]
fn the_router_and_the_contract_have_the_same_routes() {
    let contract = contract();
    let methods = ["get", "post", "put", "delete", "patch"];
    let promised: BTreeSet<_> = contract["paths"]
        .as_object()
        .expect("paths")
        .iter()
        .flat_map(|(path, item)| {
            methods.iter().filter(|m| item.get(**m).is_some()).map(move |m| (m.to_uppercase(), path.clone()))
        })
        .collect();
    let kept: BTreeSet<_> =
        routes().into_iter().map(|(method, path, _)| (method.to_owned(), path.to_owned())).collect();
    assert_eq!(promised, kept);
}

#[test]
fn the_scopes_of_the_contract_are_asked_for() {
    let contract = contract();
    for (method, path, scope) in routes() {
        let promised = &contract["paths"][path][method.to_lowercase()]["security"];
        let kept = match scope {
            Some(scope) => json!([{}, { "key": [scope] }, { "password": [scope] }]),
            None => json!([]),
        };
        assert_eq!(*promised, kept, "{method} {path}");
    }
}

#[test]
fn every_reference_leads_somewhere() {
    let contract = contract();
    let mut open = vec![&contract];
    while let Some(value) = open.pop() {
        if let Some(reference) = value.get("$ref").and_then(Value::as_str) {
            assert!(contract.pointer(reference.trim_start_matches('#')).is_some(), "{reference}");
        }
        open.extend(value.as_object().into_iter().flat_map(|object| object.values()));
        open.extend(value.as_array().into_iter().flatten());
    }
}

/// What OpenAPI 3.1 allows in an object, by where it stands (the parts that the contract uses).
const FIELDS: [(&str, &[&str]); 6] = [
    ("tags", &["name", "description"]),
    ("parameters", &["name", "in", "description", "required", "style", "explode", "schema", "example"]),
    ("headers", &["description", "schema", "example"]),
    ("responses", &["description", "headers", "content"]),
    ("content", &["schema", "example"]),
    (
        "operations",
        &["tags", "operationId", "summary", "description", "parameters", "requestBody", "responses", "security"],
    ),
];

/// Faults of an object or list of such objects, each with its place.
fn wrong_fields(kind: &str, value: &Value, place: &str, faults: &mut Vec<String>) {
    let known = FIELDS.iter().find(|(name, _)| *name == kind).map(|(_, known)| *known).unwrap_or_default();
    let Some(object) = value.as_object() else { return faults.push(format!("{place} is no object")) };
    if object.contains_key("$ref") {
        return;
    }
    faults.extend(object.keys().filter(|key| !known.contains(&key.as_str())).map(|key| format!("{place}: `{key}`")));
    let needed: &[&str] = match kind {
        "parameters" => &["name", "in"],
        "responses" => &["description"],
        "tags" => &["name"],
        _ => &[],
    };
    let text = |field: &&&str| object.get(**field).is_some_and(Value::is_string);
    faults.extend(needed.iter().filter(|field| !text(field)).map(|field| format!("{place}: no text in `{field}`")));
}

/// Looks through the contract: a comma or a word that YAML reads otherwise than it looks leaves a trace here.
fn faults_of_form(value: &Value, place: &str, faults: &mut Vec<String>) {
    let children: Vec<(String, &Value)> = match value {
        Value::Object(object) => object.iter().map(|(key, child)| (key.clone(), child)).collect(),
        Value::Array(list) => list.iter().enumerate().map(|(index, child)| (index.to_string(), child)).collect(),
        Value::Null if !place.ends_with("/default") => return faults.push(format!("{place} is null")),
        _ => return,
    };
    let above = place.rsplit('/').next().unwrap_or_default();
    for (name, child) in children {
        let below = format!("{place}/{name}");
        let kind = if ["get", "post", "put", "delete"].contains(&name.as_str()) { "operations" } else { above };
        // Within a schema these are names of properties.
        let in_schema = place.contains("/schemas/") || place.contains("/schema/");
        if !in_schema
            && FIELDS.iter().any(|(known, _)| *known == kind)
            && !(place.contains("/tags") && child.is_string())
        {
            wrong_fields(kind, child, &below, faults);
        }
        if name == "description" && !child.is_string() && !place.ends_with("/properties") {
            faults.push(format!("{below} is no text"));
        }
        faults_of_form(child, &below, faults);
    }
}

#[test]
fn the_contract_is_openapi() {
    let mut contract = contract();
    assert_eq!(contract["openapi"], "3.1.0");
    let faults = |contract: &Value| {
        let mut faults = Vec::new();
        faults_of_form(contract, "", &mut faults);
        faults
    };
    assert_eq!(faults(&contract), Vec::<String>::new());
    contract["paths"]["/v1/jobs/{id}/preview"]["get"]["parameters"][0]["name"] = json!(false);
    contract["components"]["responses"]["Picture"]["headers"]["ETag"]["interface and driver"] = json!("");
    contract["tags"][0]["limits"] = Value::Null;
    assert_eq!(faults(&contract).len(), 4, "{:?}", faults(&contract));
}

#[test]
fn every_code_is_in_the_contract() {
    let contract = contract();
    let listed = contract["components"]["schemas"]["Problem"]["properties"]["code"]["examples"].clone();
    let listed: Vec<_> = listed.as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    for code in candela::jobs::Code::ALL {
        assert!(listed.contains(&code.id()), "{}", code.id());
    }
}

#[test]
fn defaults_of_the_contract_are_those_of_the_server() {
    let contract = contract();
    let promised = &contract["components"]["schemas"]["RenderParams"]["properties"];
    let kept = json!(candela::params::RenderParams::default());
    for (name, value) in kept.as_object().expect("an object") {
        let field = promised.get(name).unwrap_or_else(|| panic!("the contract lacks {name}"));
        if let Some(default) = field.get("default") {
            assert_eq!(default, value, "{name}");
        }
    }
    let names: BTreeSet<_> = promised.as_object().expect("an object").keys().collect();
    let mut known: BTreeSet<_> = kept.as_object().expect("an object").keys().collect();
    let environment = "environment".to_owned();
    known.insert(&environment);
    assert_eq!(names, known);
}

#[test]
fn replies_have_the_shapes_that_are_promised() {
    let server = Server::start();
    let contract = contract();
    let check = |method: &str, path: &str, reply: &Reply| conforms_to_route(&contract, method, path, reply);

    let created = server.post("/v1/scenes", "model/gltf-binary", &triangle());
    check("post", "/v1/scenes", &created);
    let scene = created.json()["id"].as_str().expect("an id").to_owned();
    let with_camera = crate::support::with_camera();
    check("post", "/v1/scenes", &server.post("/v1/scenes", "model/gltf+json", with_camera.as_bytes()));
    check("get", "/v1/scenes", &server.get("/v1/scenes"));
    check("get", "/v1/scenes/{id}", &server.get(&format!("/v1/scenes/{scene}")));
    check("get", "/v1/scenes/{id}", &server.get("/v1/scenes/none"));
    let image = server.post("/v1/images", "image/vnd.radiance", &crate::support::radiance());
    check("post", "/v1/images", &image);

    let accepted = server.post_json("/v1/jobs", &json!({ "scene": scene, "params": tiny() }));
    check("post", "/v1/jobs", &accepted);
    let id = accepted.json()["id"].as_str().expect("an id").to_owned();
    server.wait_for(&id, &["succeeded"]);
    check("get", "/v1/jobs/{id}", &server.get(&format!("/v1/jobs/{id}")));
    check("get", "/v1/jobs/{id}/result", &server.get(&format!("/v1/jobs/{id}/result")));
    check("get", "/v1/jobs/{id}/result", &server.get(&format!("/v1/jobs/{id}/result?aov=standard_error")));
    check("get", "/v1/jobs/{id}/result", &server.get(&format!("/v1/jobs/{id}/result?aov=depth")));
    check("get", "/v1/jobs", &server.get("/v1/jobs"));
    check("post", "/v1/jobs", &server.post_json("/v1/jobs", &json!({ "scene": 1 })));
    let long = server.begin(&scene, &endless());
    check("post", "/v1/jobs/{id}/cancel", &server.send("POST", &format!("/v1/jobs/{long}/cancel"), &[], &[]));
    check("post", "/v1/jobs/{id}/cancel", &server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], &[]));
    check(
        "post",
        "/v1/render",
        &server.post("/v1/render?width=8&height=8&max_samples=2", "model/gltf-binary", &triangle()),
    );
    check("post", "/v1/render", &server.post("/v1/render?width=0", "model/gltf-binary", &triangle()));
    check("post", "/v1/render", &server.post("/v1/render", "text/plain", b"a"));
    let named = server.send("PUT", "/v1/jobs/mine", &[("content-type", "application/json")], b"{}");
    check("put", "/v1/jobs/{id}", &named);
    let body = json!({ "scene": scene, "params": tiny() }).to_string();
    let named = server.send("PUT", "/v1/jobs/mine", &[("content-type", "application/json")], body.as_bytes());
    check("put", "/v1/jobs/{id}", &named);
    let foreign = [("content-type", "application/json"), ("origin", "https://elsewhere.example")];
    check("put", "/v1/jobs/{id}", &server.send("PUT", "/v1/jobs/mine", &foreign, body.as_bytes()));
    check("delete", "/v1/scenes/{id}", &server.send("DELETE", "/v1/scenes/none", &foreign, &[]));
    let batch = server.post_json("/v1/batches", &json!({ "scenes": [scene], "params": tiny() }));
    check("post", "/v1/batches", &batch);
    let batch = batch.json();
    let batch_id = batch["id"].as_str().expect("an id");
    let of_batch = batch["items"][0]["job"].as_str().expect("an id");
    check("get", "/v1/batches/{id}/events", &server.get(&format!("/v1/batches/{batch_id}/events")));
    check("delete", "/v1/jobs/{id}", &server.delete(&format!("/v1/jobs/{of_batch}")));
    check("delete", "/v1/jobs/{id}", &server.delete(&format!("/v1/jobs/{id}")));
    check("delete", "/v1/jobs/{id}", &server.delete(&format!("/v1/jobs/{id}")));
    check("delete", "/v1/batches/{id}", &server.delete(&format!("/v1/batches/{batch_id}")));
    for path in ["/v1/limits", "/healthz", "/readyz", "/metrics"] {
        check("get", path, &server.get(path));
    }
}

#[test]
fn a_shape_that_differs_is_found() {
    let contract = contract();
    let problem = &contract["components"]["schemas"]["Problem"];
    let good =
        json!({ "type": "/docs/errors#a", "title": "a", "status": 400, "code": "a", "detail": "a", "request_id": "a" });
    assert_eq!(conforms(&contract, problem, &good, ""), Ok(()));
    let mut bad = good.clone();
    bad["status"] = json!("400");
    assert!(conforms(&contract, problem, &bad, "").is_err());
    bad = good.clone();
    bad["more"] = json!(1);
    assert!(conforms(&contract, problem, &bad, "").is_err());
    bad = good;
    bad.as_object_mut().expect("an object").remove("code");
    assert!(conforms(&contract, problem, &bad, "").is_err());
}

/// The reply's status is promised for the route, its type too, and if it is JSON, its shape.
fn conforms_to_route(contract: &Value, method: &str, path: &str, reply: &Reply) {
    let place = format!("{method} {path} {}", reply.status);
    let responses = &contract["paths"][path][method]["responses"];
    let response =
        resolve(contract, responses.get(reply.status.to_string()).unwrap_or_else(|| panic!("{place}: {reply:?}")));
    if response.get("content").is_none() {
        assert!(reply.body.is_empty(), "{place}: no body is promised: {reply:?}");
        return;
    }
    let kind = reply.header("content-type").unwrap_or_default();
    let media = response["content"].get(kind).unwrap_or_else(|| panic!("{place}: {kind} is not promised"));
    if kind.ends_with("json") {
        conforms(contract, &media["schema"], &reply.json(), "").unwrap_or_else(|fault| panic!("{place}: {fault}"));
    }
}

fn resolve<'a>(contract: &'a Value, value: &'a Value) -> &'a Value {
    match value.get("$ref").and_then(Value::as_str) {
        Some(reference) => {
            contract.pointer(reference.trim_start_matches('#')).expect("a reference that leads somewhere")
        }
        None => value,
    }
}

/// As much of JSON Schema as the contract uses.
fn conforms(contract: &Value, schema: &Value, value: &Value, place: &str) -> Result<(), String> {
    let schema = resolve(contract, schema);
    for any in ["oneOf", "anyOf"] {
        if let Some(options) = schema.get(any).and_then(Value::as_array) {
            let fits = options.iter().filter(|option| conforms(contract, option, value, place).is_ok()).count();
            if fits == 0 {
                return Err(format!("{place}: {value} is none of {any}"));
            }
        }
    }
    if let Some(kind) = schema.get("type") {
        let kinds: Vec<_> = kind.as_array().map_or_else(|| vec![kind], |kinds| kinds.iter().collect());
        if !kinds.iter().any(|kind| is_of(value, kind.as_str().unwrap_or_default())) {
            return Err(format!("{place}: {value} is not of type {kind}"));
        }
    }
    if schema.get("enum").and_then(Value::as_array).is_some_and(|known| !known.contains(value)) {
        return Err(format!("{place}: {value} is not listed"));
    }
    if let (Some(items), Some(array)) = (schema.get("items"), value.as_array()) {
        for (index, item) in array.iter().enumerate() {
            conforms(contract, items, item, &format!("{place}/{index}"))?;
        }
    }
    match value.as_object() {
        Some(object) => fields_conform(contract, schema, object, place),
        None => Ok(()),
    }
}

fn fields_conform(
    contract: &Value,
    schema: &Value,
    object: &serde_json::Map<String, Value>,
    place: &str,
) -> Result<(), String> {
    for name in schema.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str) {
        if !object.contains_key(name) {
            return Err(format!("{place}: {name} is missing"));
        }
    }
    for (name, field) in object {
        match schema.get("properties").and_then(|properties| properties.get(name)) {
            Some(schema) => conforms(contract, schema, field, &format!("{place}/{name}"))?,
            None if schema.get("additionalProperties") == Some(&Value::Bool(false)) => {
                return Err(format!("{place}: {name} is not promised"));
            }
            None => {}
        }
    }
    Ok(())
}

fn is_of(value: &Value, kind: &str) -> bool {
    match kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "number" => value.is_number(),
        "integer" => value.is_u64() || value.is_i64(),
        "null" => value.is_null(),
        _ => false,
    }
}
