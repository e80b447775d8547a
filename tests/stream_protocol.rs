//! What a client of the state stream is told, and what it may ask for.

use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;
use tumbled::stream::{Class, Hello, Limits};

use crate::support::stream::{Client, hello, large, marked, server, wait_until};

#[test]
fn hello_comes_first_and_says_what_the_numbers_mean() {
    let server = server(Limits::default());
    let stream = std::net::TcpStream::connect(server.addresses().tcp.expect("TCP")).expect("connects");
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stream), &mut line).expect("a line");
    assert!(line.starts_with(r#"{"class":"HELLO","protocol":1,"#), "{line}");
    let told: Hello = serde_json::from_str(&line).expect("a HELLO");
    assert_eq!(told, hello());
    let line: serde_json::Value = serde_json::from_str(&line).expect("JSON");
    assert_eq!(line["classes"], json!(Class::ALL.map(Class::name)));
    assert_eq!((&line["origin"], &line["unix_ns"]), (&json!("simulated"), &json!("1795341600000000000")));
    assert_eq!((&line["seq"], &line["dropped"]), (&json!(0), &json!(0)));
}

#[test]
fn a_client_that_asks_for_nothing_gets_state_and_health() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    let publisher = server.publisher();
    for (mark, class) in Class::ALL.into_iter().enumerate() {
        publisher.publish_json(class, marked(class, mark));
    }
    assert_eq!(client.next(), json!({ "class": "STATE", "mark": 1, "seq": 1, "dropped": 0 }));
    assert_eq!(client.next(), json!({ "class": "HEALTH", "mark": 2, "seq": 2, "dropped": 0 }));
    server.stop();
    assert_eq!(client.next()["code"], "stopping");
}

#[test]
fn a_client_gets_what_it_subscribed_to_until_it_subscribes_anew() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    let publisher = server.publisher();
    assert!(!publisher.wants(Class::Cloud));
    client.subscribe(&server, &[Class::Cloud, Class::Event], None);
    assert!(!publisher.wants(Class::Health));
    for class in [Class::Health, Class::Cloud, Class::Event] {
        publisher.publish_json(class, marked(class, 0));
    }
    assert_eq!((client.next()["class"].clone(), client.next()["class"].clone()), (json!("CLOUD"), json!("EVENT")));
    client.subscribe(&server, &[Class::Health], None);
    for class in [Class::Cloud, Class::Event, Class::Health] {
        publisher.publish_json(class, marked(class, 0));
    }
    assert_eq!(client.next()["class"], "HEALTH");
    drop(client);
    wait_until("the client has left", || !publisher.wants(Class::Health));
}

#[test]
fn a_class_of_which_nothing_comes_holds_up_no_other() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    client.subscribe(&server, &[Class::State, Class::Point, Class::Health], None);
    server.publisher().publish_json(Class::Health, marked(Class::Health, 0));
    assert_eq!(client.next()["class"], "HEALTH");
}

#[test]
fn an_unknown_class_is_answered_with_those_there_are_and_the_client_stays() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    client.send("{\"subscribe\":[\"CLOUD\",\"PONIT\"]}\r\n\n");
    let error = client.next();
    assert_eq!((&error["code"], &error["closing"]), (&json!("unknown_class"), &json!(false)));
    assert_eq!(error["supported"], json!(Class::ALL.map(Class::name)));
    assert!(error["message"].as_str().is_some_and(|message| message.contains("PONIT")));
    assert!(!server.publisher().wants(Class::Cloud), "nothing of a refused request is carried out");
    client.subscribe(&server, &[Class::Cloud], None);
}

#[test]
fn what_is_no_request_is_told_and_ends_the_connection() {
    let server = server(Limits::default());
    let deep = format!("{{\"a\":{}{}}}\n", "[".repeat(16), "]".repeat(16));
    let (long, ten_megabytes) = (vec![b' '; 64 * 1024 + 1], vec![b'x'; 10 << 20]);
    let cases: [(&[u8], &str); 5] = [
        (b"GET / HTTP/1.1\r\nHost: rig\r\n\r\n", "malformed"),
        (b"\xff\xfe\x00\n", "malformed"),
        (deep.as_bytes(), "too_deep"),
        (&long, "too_long"),
        (&ten_megabytes, "too_long"),
    ];
    for (bytes, code) in cases {
        let mut client = Client::connect(&server);
        // More than the server takes may still be under way when it closes: then this fails, as it should.
        let sent = thread::scope(|scope| {
            let mut half = client.try_clone();
            let sending = scope.spawn(move || std::io::Write::write_all(&mut half, bytes));
            let error = client.next();
            assert_eq!((&error["code"], &error["closing"]), (&json!(code), &json!(true)));
            client.assert_closed();
            drop(client);
            sending.join().expect("no panic")
        });
        assert!(sent.is_ok() || bytes.len() > 1 << 20, "{code}");
    }
    wait_until("all have left", || server.clients().clients == 0);
}

#[test]
fn more_than_twenty_requests_in_a_second_end_the_connection() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    client.send("{\"max_hz\":10}\n".repeat(21));
    let error = client.next();
    assert_eq!((&error["code"], &error["closing"]), (&json!("too_many_requests"), &json!(true)));
    client.assert_closed();
}

#[test]
fn max_hz_thins_out_and_the_newest_comes_through() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    client.subscribe(&server, &[Class::Cloud], Some(20.0));
    let publisher = server.publisher();
    let started = Instant::now();
    for mark in 0..100 {
        publisher.publish_json(Class::Cloud, marked(Class::Cloud, mark));
        thread::sleep(Duration::from_millis(5));
    }
    // 20 lines a second, one at the start and one held at the end.
    let most = 2 + (started.elapsed().as_secs_f64() * 20.0).ceil() as u64;
    let last = loop {
        let line = client.next();
        assert_eq!(line["dropped"], 0, "thinned out as asked for is not dropped");
        if line["mark"] == 99 {
            break line;
        }
    };
    // The first two lines were HELLO and the answer to the subscription.
    let clouds = last["seq"].as_u64().expect("a number") - 1;
    assert!((2..=most).contains(&clouds), "{clouds} lines, at most {most}");
}

#[test]
fn dropped_lines_are_told_and_the_numbers_go_on_without_a_gap() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    client.subscribe(&server, &[Class::Cloud], None);
    let publisher = server.publisher();
    // Published until some had to go: the sockets' buffers hold some megabytes, the queue 64 lines.
    let mut published = 0;
    while server.clients().dropped < 10 {
        publisher.publish_json(Class::Cloud, large(Class::Cloud, published, 100_000));
        published += 1;
    }
    let (mut seq, mut received, mut dropped, mut marks) = (2, 0, 0, Vec::new());
    while received + dropped < published {
        let line = client.next();
        assert_eq!(line["seq"], seq);
        seq += 1;
        received += 1;
        dropped += line["dropped"].as_u64().expect("a number") as usize;
        marks.push(line["mark"].as_u64().expect("a mark"));
    }
    assert_eq!((received + dropped, dropped as u64), (published, server.clients().dropped));
    assert!(marks.is_sorted() && marks.last() == Some(&(published as u64 - 1)), "the oldest are dropped");
}

#[test]
fn a_client_that_still_sends_when_its_connection_ends_is_not_reset() {
    // A reset makes some systems throw away the line that says why.
    let server = server(Limits { farewell: Duration::from_secs(600), ..Limits::default() });
    let mut client = Client::connect(&server);
    client.send(vec![b'x'; 200 * 1024]);
    assert_eq!(client.next()["code"], "too_long");
    assert_eq!(client.text(), None);
    for _ in 0..5 {
        client.send("more");
        thread::sleep(Duration::from_millis(10));
    }
    drop(client);
    wait_until("it is let go", || server.clients().clients == 0);
}

#[test]
fn a_client_that_closes_its_sending_side_gets_what_waits_and_is_let_go() {
    const LINES: usize = 60; // 6 MB: more than the sockets hold, less than the queue
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    for mark in 0..LINES {
        server.publisher().publish_json(Class::Health, large(Class::Health, mark, 100_000));
    }
    client.half_close();
    for mark in 0..LINES {
        assert_eq!(client.next()["mark"], mark);
    }
    client.assert_closed();
    wait_until("it is let go", || server.clients().clients == 0);
}

#[test]
fn at_the_stop_clients_get_what_waits_and_a_last_line() {
    let server = server(Limits::default());
    let mut client = Client::connect(&server);
    // This one never reads: it must not hold up the end.
    let mute = Client::connect(&server);
    let publisher = server.publisher();
    for mark in 0..50 {
        publisher.publish_json(Class::Health, large(Class::Health, mark, 100_000));
    }
    let reading = thread::spawn(move || {
        let lines: Vec<serde_json::Value> =
            std::iter::from_fn(|| client.text()).map(|line| serde_json::from_str(&line).expect("JSON")).collect();
        lines
    });
    server.stop();
    let lines = reading.join().expect("no panic");
    drop(mute);
    assert_eq!(lines.len(), 51);
    let last = lines.last().expect("a last line");
    assert_eq!((&last["class"], &last["code"], &last["seq"]), (&json!("ERROR"), &json!("stopping"), &json!(51)));
    // Whoever still publishes is not disturbed.
    publisher.publish_json(Class::Health, marked(Class::Health, 0));
}
