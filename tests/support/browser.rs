//! A headless browser with one page, asked over its debugging port.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use super::Workbench;

const PROGRAM: &str = "/usr/bin/chromium";

/// A running browser; it ends when this is dropped.
pub(crate) struct Browser {
    child: Child,
    page: WebSocket<TcpStream>,
    asked: u64,
    /// What the page's console calls an error: scripts that failed, requests that were refused.
    complaints: Vec<String>,
}

impl Browser {
    /// Starts one on `url`; `None`: there is none on this machine, which is told.
    pub(crate) fn open(bench: &Workbench, url: &str) -> Option<Self> {
        if !Path::new(PROGRAM).exists() {
            println!("skipped: {PROGRAM} is not there");
            return None;
        }
        let mut command = Command::new(PROGRAM);
        command.args(["--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]);
        command.arg(format!("--user-data-dir={}", bench.path("browser").display()));
        command.args(["--window-size=1400,1000", "--remote-debugging-port=0", url]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the browser starts");
        let mut log = BufReader::new(child.stderr.take().expect("piped"));
        let mut line = String::new();
        let port = loop {
            line.clear();
            assert!(log.read_line(&mut line).expect("a log") > 0, "the browser ended");
            if let Some((_, rest)) = line.split_once("ws://") {
                break rest.split('/').next().expect("an address").to_owned();
            }
        };
        // What it still says is read, so that it never waits for us.
        std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        let address = page_address(&port);
        let stream = TcpStream::connect(&port).expect("connects");
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
        let (page, _) = tungstenite::client::client(&*address, stream).expect("accepted");
        let mut browser = Self { child, page, asked: 0, complaints: Vec::new() };
        // What the log holds already is told then.
        browser.request("Log.enable", &json!({}));
        browser.request("Runtime.enable", &json!({}));
        Some(browser)
    }

    /// The value of an expression in the page.
    pub(crate) fn value(&mut self, expression: &str) -> Value {
        let mut answer = self.request("Runtime.evaluate", &json!({ "expression": expression, "returnByValue": true }));
        answer["result"]["result"]["value"].take()
    }

    fn request(&mut self, method: &str, params: &Value) -> Value {
        self.asked += 1;
        let request = json!({ "id": self.asked, "method": method, "params": params });
        self.page.send(Message::text(request.to_string())).expect("sends");
        loop {
            let Message::Text(text) = self.page.read().expect("an answer") else { continue };
            let answer: Value = serde_json::from_str(&text).expect("JSON");
            if answer["id"] == self.asked {
                return answer;
            }
            let failed = answer["method"] == "Runtime.exceptionThrown";
            if failed || (answer["method"] == "Log.entryAdded" && answer["params"]["entry"]["level"] == "error") {
                self.complaints.push(answer["params"].to_string());
            }
        }
    }

    /// What the page's console called an error up to now.
    pub(crate) fn complaints(&mut self) -> &[String] {
        self.value("1");
        &self.complaints
    }

    /// Opens another page and waits until its scripts have run.
    pub(crate) fn go(&mut self, url: &str) {
        self.request("Page.navigate", &json!({ "url": url }));
        while self.value("document.readyState").as_str() != Some("complete") {
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Presses a button.
    pub(crate) fn press(&mut self, id: &str) {
        self.value(&format!("document.getElementById('{id}').click()"));
    }

    /// The text of an element.
    pub(crate) fn text_of(&mut self, id: &str) -> String {
        self.value(&format!("document.getElementById('{id}')?.textContent")).as_str().unwrap_or_default().to_owned()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.child.kill().and_then(|()| self.child.wait()).expect("it ends");
    }
}

/// The debugging address of the page.
fn page_address(port: &str) -> String {
    let mut stream = TcpStream::connect(port).expect("connects");
    write!(stream, "GET /json/list HTTP/1.1\r\nHost: {port}\r\nConnection: close\r\n\r\n").expect("sends");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a timeout");
    let mut reader = BufReader::new(stream);
    let (mut line, mut length) = (String::new(), 0);
    while line != "\r\n" {
        line.clear();
        assert!(reader.read_line(&mut line).expect("a head") > 0, "no answer");
        if let Some((_, value)) = line.split_once(':').filter(|(key, _)| key.eq_ignore_ascii_case("content-length")) {
            length = value.trim().parse().expect("a length");
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).expect("the list");
    let list: Value = serde_json::from_slice(&body).expect("JSON");
    let pages = list.as_array().expect("a list");
    let page = pages.iter().find(|page| page["type"] == "page").expect("a page");
    page["webSocketDebuggerUrl"].as_str().expect("an address").to_owned()
}
