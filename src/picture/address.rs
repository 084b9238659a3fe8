//! Where a viewer listens.

use std::fmt;
use std::str::FromStr;

/// tev's port.
const USUAL_PORT: u16 = 14158;

/// A host, by name or number, and a TCP port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Name or number of the host, IPv6 without brackets.
    pub host: String,
    /// The port.
    pub port: u16,
}

impl FromStr for Address {
    type Err = String;

    /// Reads `HOST` or `HOST:PORT`; without a port it is tev's. Colons of IPv6 need brackets around them.
    fn from_str(text: &str) -> Result<Self, String> {
        let (host, port) = match text.strip_prefix('[').map(|rest| rest.split_once(']')) {
            Some(Some((host, rest))) => (host, rest.strip_prefix(':').or_else(|| rest.is_empty().then_some(""))),
            Some(None) => ("", None),
            None => match text.split_once(':') {
                Some((host, port)) => (host, Some(port)),
                None => (text, Some("")),
            },
        };
        let given = !text.ends_with(':');
        let port = port.and_then(|port| match port {
            "" if given => Some(USUAL_PORT),
            port => port.parse().ok().filter(|&port| port != 0),
        });
        match port {
            Some(port) if !host.is_empty() => Ok(Self { host: host.to_owned(), port }),
            _ => Err("expected HOST or HOST:PORT, such as localhost:14158 or [::1]:14158".to_owned()),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.host.contains(':') {
            true => write!(f, "[{}]:{}", self.host, self.port),
            false => write!(f, "{}:{}", self.host, self.port),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_told() {
        for (text, host, port, told) in [
            ("localhost", "localhost", 14158, "localhost:14158"),
            ("10.0.0.7:80", "10.0.0.7", 80, "10.0.0.7:80"),
            ("[::1]:14159", "::1", 14159, "[::1]:14159"),
            ("[::1]", "::1", 14158, "[::1]:14158"),
        ] {
            let address: Address = text.parse().unwrap();
            assert_eq!((address.host.as_str(), address.port), (host, port));
            assert_eq!(address.to_string(), told);
        }
        for bad in ["", ":", ":80", "a:", "a:0", "a:65536", "a:-1", "a:b", "::1", "[::1", "[::1]80", "[]:80", "[a]:"] {
            assert!(bad.parse::<Address>().is_err(), "{bad:?}");
        }
    }
}
