//! Telling others of the end of a job, after Standard Webhooks (standardwebhooks.com): signed, sent again until taken, and only to
//! addresses that the operator allows.

use super::Core;
use super::ledger::{Change, Delivery, deliveries, now};
use super::problem::{Code, Problem};
use crate::params::FieldError;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::sync::{Arc, Weak};
use std::time::Duration;
use ureq::config::Config;
use ureq::http::Uri;
use ureq::unversioned::resolver::{DefaultResolver, ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::{DefaultConnector, NextTimeout};
use ureq::{Agent, Error};

/// Seconds from one attempt to the next; after the last one the message is given up: three days in all.
const PAUSES: [i64; 10] = [5, 30, 120, 600, 1800, 7200, 18_000, 36_000, 72_000, 86_400];

/// Time between two looks for messages that are due.
const LOOK: Duration = Duration::from_millis(500);

/// Time of one attempt, all of it.
const PATIENCE: Duration = Duration::from_secs(15);

/// Messages under way at a time.
const AT_A_TIME: usize = 8;

/// Longest address.
const LONGEST: usize = 2000;

/// What a secret begins with as text.
const SECRET: &str = "whsec_";

/// How messages are signed, and where they may go.
#[derive(Clone)]
pub struct Webhooks {
    secret: Vec<u8>,
    /// Hosts and addresses that are allowed though they are not public.
    allowed: Arc<[String]>,
}

impl std::fmt::Debug for Webhooks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Webhooks").field("allowed", &self.allowed).finish_non_exhaustive()
    }
}

impl Webhooks {
    /// A secret as text, `whsec_` and 24 to 64 bytes in base64, and what is allowed besides public addresses.
    ///
    /// # Errors
    /// The secret is none.
    pub fn new(secret: &str, allowed: &[String]) -> Result<Self, String> {
        let bytes = secret.trim().strip_prefix(SECRET).and_then(|text| STANDARD.decode(text).ok());
        let bytes = bytes.filter(|bytes| (24..=64).contains(&bytes.len()));
        let secret = bytes.ok_or_else(|| format!("a webhook secret is `{SECRET}` and 24 to 64 bytes in base64"))?;
        Ok(Self { secret, allowed: allowed.iter().map(|host| host.trim().to_ascii_lowercase()).collect() })
    }

    /// Whether an address may be told: https, or http to a host that is allowed.
    pub(super) fn check(&self, url: &str) -> Result<(), Problem> {
        let refuse = |why: String| {
            let fault = FieldError::new("/webhook/url", why);
            Err(Problem::fields(Code::InvalidParams, vec![fault]))
        };
        let uri: Uri = match url.parse() {
            Ok(uri) if url.len() <= LONGEST => uri,
            _ => {
                return refuse(format!(
                    "must be an address of at most {LONGEST} characters, like https://example.com/hook"
                ));
            }
        };
        let (Some(scheme), Some(authority)) = (uri.scheme_str(), uri.authority()) else {
            return refuse("must be a whole address, like https://example.com/hook".to_owned());
        };
        if authority.as_str().contains('@') {
            return refuse("must not hold a name or a password: messages are signed instead".to_owned());
        }
        let is_allowed = self.allows_host(bare(authority.host()));
        match scheme {
            "https" => {}
            "http" if is_allowed => {}
            _ => return refuse("must begin with https://".to_owned()),
        }
        match bare(authority.host()).parse::<IpAddr>() {
            Ok(address) if !is_allowed && !is_public(address) => {
                refuse(format!("{address} is not a public address, and this server does not allow it"))
            }
            _ => Ok(()),
        }
    }

    fn allows_host(&self, host: &str) -> bool {
        self.allowed.iter().any(|known| known.eq_ignore_ascii_case(host))
    }

    /// `v1,` and the HMAC of id, time and body.
    fn sign(&self, id: &str, time: i64, body: &str) -> String {
        // Any length of key will do.
        let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(&self.secret) else { return String::new() };
        mac.update(format!("{id}.{time}.{body}").as_bytes());
        format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes()))
    }

    /// Sends one message. Blocks.
    fn send(&self, delivery: &Delivery) -> Result<(), Refusal> {
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(PATIENCE))
            // An address that was checked must not lead to one that was not.
            .max_redirects(0)
            .proxy(None)
            .build();
        let agent = Agent::with_parts(config, DefaultConnector::default(), Guard(self.clone()));
        let time = now() / 1000;
        let request = agent
            .post(&delivery.url)
            .header("content-type", "application/json")
            .header("user-agent", concat!("candela/", env!("CARGO_PKG_VERSION")))
            .header("webhook-id", &delivery.id)
            .header("webhook-timestamp", time.to_string())
            .header("webhook-signature", self.sign(&delivery.id, time, &delivery.body));
        let reply =
            request.send(&delivery.body).map_err(|error| Refusal { why: error.to_string(), for_good: false })?;
        match reply.status().as_u16() {
            200..=299 => Ok(()),
            410 => Err(Refusal { why: "410: nobody listens any more".to_owned(), for_good: true }),
            status => Err(Refusal { why: format!("answered {status}"), for_good: false }),
        }
    }
}

/// Why a message was not taken.
struct Refusal {
    why: String,
    for_good: bool,
}

/// Resolves names, and lets only addresses through that may be told; the connection then goes to just these.
#[derive(Debug)]
struct Guard(Webhooks);

impl Resolver for Guard {
    fn resolve(&self, uri: &Uri, config: &Config, timeout: NextTimeout) -> Result<ResolvedSocketAddrs, Error> {
        let found = DefaultResolver::default().resolve(uri, config, timeout)?;
        let host = uri.host().map(bare).unwrap_or_default();
        let may = |address: &IpAddr| {
            is_public(*address) || self.0.allows_host(host) || self.0.allows_host(&address.to_canonical().to_string())
        };
        match found.iter().map(std::net::SocketAddr::ip).find(|address| !may(address)) {
            Some(address) => Err(Error::Other(format!("{host} is {address}, which is not a public address").into())),
            None => Ok(found),
        }
    }
}

/// A host without the brackets of an IPv6 address.
fn bare(host: &str) -> &str {
    host.trim_start_matches('[').trim_end_matches(']')
}

/// Whether an address belongs to the public internet (the special registries of RFC 6890 and its updates are not).
fn is_public(address: IpAddr) -> bool {
    match address.to_canonical() {
        IpAddr::V4(v4) => is_public_v4(v4),
        IpAddr::V6(v6) => is_public_v6(v6),
    }
}

fn is_public_v4(address: Ipv4Addr) -> bool {
    let [a, b, c, _] = address.octets();
    let is_special = matches!(
        (a, b, c),
        (0 | 10 | 127 | 224.., ..)
            | (169, 254, _)
            | (172, 16..=31, _)
            | (192, 168, _)
            | (192, 0, 0 | 2)
            | (192, 88, 99)
            | (198, 18..=19, _)
            | (198, 51, 100)
            | (203, 0, 113)
            | (100, 64..=127, _)
    );
    !is_special
}

fn is_public_v6(address: Ipv6Addr) -> bool {
    let [a, b, ..] = address.segments();
    // What is given out at all, less tunnels, documentation and protocol assignments.
    let is_special = match a {
        0x2001 => b < 0x200 || b == 0xdb8,
        0x2002 => true,
        0x3fff => b < 0x1000,
        _ => false,
    };
    (0x2000..=0x3fff).contains(&a) && !is_special
}

/// Sends what is due, until the service is gone.
pub(super) async fn deliver(core: Weak<Core>, webhooks: Webhooks) {
    loop {
        let Some(ledger) = core.upgrade().map(|core| core.storage.ledger.clone()) else { return };
        let due = ledger.ask(|c| deliveries(c, now(), AT_A_TIME)).await;
        let due = match due {
            Ok(due) => due,
            Err(super::ledger::LedgerError::Closed) => return,
            Err(error) => {
                tracing::error!(%error, "messages cannot be read");
                Vec::new()
            }
        };
        let is_idle = due.is_empty();
        let sending: Vec<_> = due
            .into_iter()
            .map(|delivery| {
                let webhooks = webhooks.clone();
                tokio::task::spawn_blocking(move || (webhooks.send(&delivery), delivery))
            })
            .collect();
        for sent in sending {
            let Ok((result, delivery)) = sent.await else { continue };
            let change = after(result, &delivery);
            if let Some(core) = core.upgrade() {
                match &change {
                    Change::Delivered(_) => core.meters.told.inc(),
                    _ => core.meters.untold.inc(),
                };
            }
            let _ = ledger.commit(change).await;
        }
        if is_idle {
            tokio::time::sleep(LOOK).await;
        }
    }
}

/// What becomes of a message.
fn after(result: Result<(), Refusal>, delivery: &Delivery) -> Change {
    let Delivery { id, url, attempts, .. } = delivery;
    match result {
        Ok(()) => {
            tracing::info!(%id, %url, "webhook taken");
            Change::Delivered(id.clone())
        }
        Err(Refusal { why, for_good }) => match PAUSES.get(*attempts as usize).filter(|_| !for_good) {
            Some(pause) => {
                tracing::warn!(%id, %url, %why, seconds = pause, "webhook not taken; it is sent again");
                Change::Postponed { id: id.clone(), due: now() + pause * 1000 }
            }
            None => {
                tracing::error!(%id, %url, %why, "webhook given up");
                Change::GivenUp(id.clone())
            }
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn webhooks(allowed: &[&str]) -> Webhooks {
        let allowed: Vec<String> = allowed.iter().map(|host| (*host).to_owned()).collect();
        Webhooks::new("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", &allowed).unwrap()
    }

    #[test]
    fn the_signature_is_that_of_the_standard() {
        // The example of the specification's reference libraries.
        let body = r#"{"test": 2432232314}"#;
        let signature = webhooks(&[]).sign("msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, body);
        assert_eq!(signature, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
        assert!(Webhooks::new("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", &[]).is_err());
        assert!(Webhooks::new("whsec_AAAA", &[]).is_err());
    }

    #[test]
    fn only_public_addresses_are_told() {
        let private = [
            "127.0.0.1",
            "10.1.2.3",
            "172.16.0.1",
            "172.31.9.9",
            "192.168.1.1",
            "169.254.169.254",
            "100.64.0.1",
            "0.0.0.0",
            "255.255.255.255",
            "224.0.0.1",
            "198.18.0.1",
            "192.0.2.1",
            "::1",
            "::",
            "fe80::1",
            "fc00::1",
            "fd12::1",
            "ff02::1",
            "::ffff:127.0.0.1",
            "::ffff:10.0.0.1",
            "2001:db8::1",
            "2002:7f00:1::",
            "64:ff9b::7f00:1",
            "2001::1",
            "100::1",
        ];
        for address in private {
            assert!(!is_public(address.parse().unwrap()), "{address}");
        }
        for address in
            ["1.1.1.1", "8.8.8.8", "172.32.0.1", "100.128.0.1", "2606:4700::1111", "2a00::1", "::ffff:1.1.1.1"]
        {
            assert!(is_public(address.parse().unwrap()), "{address}");
        }
    }

    #[test]
    fn addresses_are_checked_before_anything_is_begun() {
        let none = webhooks(&[]);
        none.check("https://example.com/hook?a=b").unwrap();
        for bad in [
            "http://example.com/",
            "ftp://example.com/",
            "example.com",
            "",
            "https://me:secret@example.com/",
            "https://127.0.0.1/",
            "https://[::1]/",
            "https://10.0.0.1:8443/",
            "/hook",
            &format!("https://example.com/{}", "x".repeat(LONGEST)),
        ] {
            assert!(none.check(bad).is_err(), "{bad}");
        }
        let some = webhooks(&["127.0.0.1", "hooks.internal"]);
        some.check("http://127.0.0.1:9/hook").unwrap();
        some.check("http://hooks.internal/").unwrap();
        assert!(some.check("http://127.0.0.2:9/hook").is_err());
    }

    #[test]
    fn a_name_that_resolves_to_this_machine_is_not_told() {
        let delivery =
            Delivery { id: "msg_1".into(), url: "https://localhost:1/".into(), body: "{}".into(), attempts: 0 };
        let Err(refusal) = webhooks(&[]).send(&delivery) else { panic!("it was sent") };
        assert!(refusal.why.contains("not a public address"), "{}", refusal.why);
        let Err(refusal) = webhooks(&["localhost"]).send(&delivery) else { panic!("nobody listens") };
        assert!(!refusal.why.contains("not a public address"), "{}", refusal.why);
    }

    #[test]
    fn messages_are_given_up_in_the_end() {
        let delivery = |attempts| Delivery { id: "a".into(), url: "b".into(), body: String::new(), attempts };
        let refused = |for_good| Err(Refusal { why: "no".into(), for_good });
        assert!(matches!(after(refused(false), &delivery(0)), Change::Postponed { .. }));
        assert!(matches!(after(refused(false), &delivery(10)), Change::GivenUp(_)));
        assert!(matches!(after(refused(true), &delivery(0)), Change::GivenUp(_)));
        assert!(matches!(after(Ok(()), &delivery(3)), Change::Delivered(_)));
    }
}
