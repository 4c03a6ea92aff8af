//! Vectors of plain data as bytes, for serde: what goes from one process to another is copied, not looked at number by number.

use bytemuck::Pod;
use serde::de::{Error, Visitor};
use serde::{Deserializer, Serialize, Serializer};
use std::fmt::{self, Formatter};
use std::marker::PhantomData;

/// For `#[serde(with = "crate::pod")]`.
pub fn serialize<T: Pod, S: Serializer>(items: &[T], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytemuck::cast_slice(items))
}

/// For `#[serde(with = "crate::pod")]`.
///
/// # Errors
/// The bytes are no whole number of items.
pub fn deserialize<'de, T: Pod, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_bytes(Bytes(PhantomData))
}

struct Bytes<T>(PhantomData<T>);

impl<T: Pod> Visitor<'_> for Bytes<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number of items of {} bytes", size_of::<T>())
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<T>, E> {
        if !bytes.len().is_multiple_of(size_of::<T>()) {
            return Err(E::invalid_length(bytes.len(), &self));
        }
        let mut items = vec![T::zeroed(); bytes.len() / size_of::<T>()];
        bytemuck::cast_slice_mut(&mut items).copy_from_slice(bytes);
        Ok(items)
    }
}

/// The same of a list of such vectors: `#[serde(with = "crate::pod::nested")]`.
pub mod nested {
    use super::{Pod, Serialize, Serializer};
    use serde::{Deserialize, Deserializer};

    #[derive(Serialize)]
    struct Borrowed<'a, T: Pod>(#[serde(serialize_with = "super::serialize")] &'a [T]);

    #[derive(Deserialize)]
    struct Owned<T: Pod>(#[serde(deserialize_with = "super::deserialize", bound = "T: Pod")] Vec<T>);

    /// For `#[serde(with = "crate::pod::nested")]`.
    pub fn serialize<T: Pod, S: Serializer>(lists: &[Vec<T>], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(lists.iter().map(|list| Borrowed(list)))
    }

    /// For `#[serde(with = "crate::pod::nested")]`.
    ///
    /// # Errors
    /// As [`super::deserialize`].
    pub fn deserialize<'de, T: Pod, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Vec<T>>, D::Error> {
        Ok(Vec::<Owned<T>>::deserialize(deserializer)?.into_iter().map(|owned| owned.0).collect())
    }
}

/// What leaves fields out where it is JSON (`skip_serializing_if`) has to be JSON within other formats, too.
pub mod as_json {
    use serde::de::{DeserializeOwned, Error};
    use serde::ser::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// For `#[serde(with = "crate::pod::as_json")]`.
    ///
    /// # Errors
    /// The value has no form in JSON.
    pub fn serialize<T: Serialize, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
        serde_json::to_string(value).map_err(S::Error::custom)?.serialize(serializer)
    }

    /// For `#[serde(with = "crate::pod::as_json")]`.
    ///
    /// # Errors
    /// The text is no such value.
    pub fn deserialize<'de, T: DeserializeOwned, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
        serde_json::from_str(&String::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use serde::{Deserialize, Serialize};

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Thing {
        #[serde(with = "super")]
        places: Vec<[f32; 3]>,
        #[serde(with = "super::nested")]
        pages: Vec<Vec<u8>>,
    }

    #[test]
    fn bits_come_back_and_a_part_is_refused() {
        let thing = Thing {
            places: vec![[1.0, f32::INFINITY, -0.0], [f32::MIN_POSITIVE; 3]],
            pages: vec![vec![1, 2], vec![], vec![3]],
        };
        let bytes = postcard::to_stdvec(&thing).unwrap();
        assert_eq!(postcard::from_bytes::<Thing>(&bytes).unwrap(), thing);
        let odd = postcard::to_stdvec(&(&[0_u8; 13][..], [[0_u8; 1]; 0])).unwrap();
        assert!(postcard::from_bytes::<Thing>(&odd).is_err());
    }
}
