//! Requests of a client of the socket.

use crate::TOPICS;
use serde::Deserialize;
use std::collections::BTreeMap;

const SUBSCRIPTIONS_MAX: usize = 32;

/// A request of a client.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
enum Wish {
    Subscribe { subscriptions: Vec<Subscription> },
    Unsubscribe { subscription_ids: Vec<u32> },
}

/// A topic, and the client's own number for it.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

/// Applies a client's message to `topics`, which maps the client's own numbers to topics. Errors: what is wrong with the message.
pub fn subscribe(text: &str, topics: &mut BTreeMap<u32, usize>) -> Result<(), String> {
    match serde_json::from_str(text).map_err(|error| error.to_string())? {
        Wish::Subscribe { subscriptions } => {
            let is_known = subscriptions.iter().all(|own| own.channel_id < TOPICS);
            if !is_known || topics.len() + subscriptions.len() > SUBSCRIPTIONS_MAX {
                return Err(format!("at most {SUBSCRIPTIONS_MAX} channelIds, below {TOPICS}"));
            }
            topics.extend(subscriptions.iter().map(|own| (own.id, own.channel_id)));
        }
        Wish::Unsubscribe { subscription_ids } => {
            topics.retain(|id, _| !subscription_ids.contains(id));
        }
    }
    Ok(())
}
