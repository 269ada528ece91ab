//! The demo without a window: nothing crosses in it, and balls do hit the flag.

use circumsphere_support::programs::succeed;

/// The number before a word in what the demo prints.
fn number(text: &str, after: &str) -> f64 {
    let rest = &text[text.find(after).unwrap_or_else(|| panic!("no {after:?} in {text}")) + after.len()..];
    let number: String = rest.trim_start().chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
    number.parse().unwrap_or_else(|error| panic!("{after:?} in {text}: {error}"))
}

/// Ten seconds: more than a round, up the ramp and down the steps. The demo counts in f64, in every tick.
#[test]
fn in_the_demo_nothing_crosses() {
    let printed = succeed("demo", &["--headless", "--frames", "720", "--check", "1"]);
    println!("{printed}");
    assert!(number(&printed, "crossings in 720 ticks:") < 0.5, "{printed}");
    assert!(number(&printed, "contacts that started:") >= 7.0, "balls hit the flag: {printed}");
    assert!(number(&printed, "of balls,") >= 2.0, "the cape touches the person and itself: {printed}");
}

#[test]
#[cfg(not(feature = "window"))]
fn without_a_window_the_demo_says_what_is_missing() {
    circumsphere_support::programs::refuse("demo", &[], &["--features window", "--headless"]);
}
