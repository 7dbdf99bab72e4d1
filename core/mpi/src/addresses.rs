//! Addresses at which other machines may reach this one, as the system's tables have them: those of networks that are up.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

/// All addresses of this machine but those that mean another machine elsewhere; that of the machine itself comes last.
pub(crate) fn of_this_machine() -> Vec<IpAddr> {
    let table = |path| std::fs::read_to_string(path).unwrap_or_default();
    let routes = v4(&table("/proc/net/fib_trie")).into_iter().map(IpAddr::from);
    let addresses = v6(&table("/proc/net/if_inet6")).into_iter().map(IpAddr::from);
    routes.chain(addresses).chain([Ipv4Addr::LOCALHOST.into()]).collect()
}

/// Local addresses in the table of routes: each stands on the line before the word for it.
fn v4(routes: &str) -> Vec<Ipv4Addr> {
    let mut found: Vec<Ipv4Addr> = Vec::new();
    let mut address = None;
    for line in routes.lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("|-- ") {
            address = text.parse::<Ipv4Addr>().ok();
        } else if let (true, Some(local)) = (line.starts_with("/32 host LOCAL"), address) {
            // The table comes twice.
            if !local.is_loopback() && !local.is_link_local() && !found.contains(&local) {
                found.push(local);
            }
        }
    }
    found
}

/// Addresses of version 6 that mean the same everywhere: scope 0 in the fourth column. Others need an interface's name.
fn v6(interfaces: &str) -> Vec<Ipv6Addr> {
    let of_line = |line: &str| {
        let mut words = line.split_whitespace();
        let (digits, scope) = (words.next()?, words.nth(2)?);
        let address = u128::from_str_radix(digits, 16).ok()?;
        (digits.len() == 32 && scope == "00").then(|| Ipv6Addr::from_bits(address))
    };
    interfaces.lines().filter_map(of_line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_found_in_the_tables_of_the_system() {
        let routes = "Main:\n  +-- 0.0.0.0/1 2 0 2\n     +-- 10.9.0.0/31 1 0 0\n        |-- 10.9.0.0\n           /24 link UNICAST\n\
                      \x20       |-- 10.9.0.1\n           /32 host LOCAL\n     |-- 10.9.0.255\n        /32 link BROADCAST\n\
                      \x20    +-- 127.0.0.0/31 1 0 0\n        |-- 127.0.0.1\n           /32 host LOCAL\n";
        assert_eq!(v4(&routes.repeat(2)), [Ipv4Addr::new(10, 9, 0, 1)]);
        let interfaces = "00000000000000000000000000000001 01 80 10 80       lo\n\
                          fe80000000000000945121fffed9a8d8 02 40 20 80     eth0\n\
                          20010db8000000000000000000000005 02 40 00 80     eth0\n";
        assert_eq!(v6(interfaces), ["2001:db8::5".parse::<Ipv6Addr>().unwrap()]);
        assert_eq!(of_this_machine().last(), Some(&Ipv4Addr::LOCALHOST.into()));
    }
}
