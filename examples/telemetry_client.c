/* Prints the telemetry of tumbled: pose and age, a line for every datagram. Layout: docs/telemetry.md.
 *
 *   cc -O2 -o telemetry_client telemetry_client.c
 *   ./telemetry_client --port 7118
 *
 * Ends with 3 when the data are not live and --allow-nonlive is not given.
 */
#define _POSIX_C_SOURCE 200809L

#include "tumbled_telemetry.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>

struct asked {
    const char *bind;
    uint16_t port;
    bool has_port;
    unsigned long count;
    bool allow_nonlive;
};

static int usage(void)
{
    fprintf(stderr, "usage: telemetry_client --port PORT [--bind ADDRESS] [--count N] [--allow-nonlive]\n");
    return 2;
}

static bool number(const char *text, unsigned long most, unsigned long *out)
{
    char *end = NULL;
    *out = strtoul(text, &end, 10);
    return *text != '\0' && *text != '-' && *end == '\0' && *out <= most;
}

static bool parse(int argc, char **argv, struct asked *asked)
{
    for (int i = 1; i < argc; i++) {
        unsigned long value = 0;
        if (strcmp(argv[i], "--allow-nonlive") == 0) {
            asked->allow_nonlive = true;
        } else if (i + 1 == argc) {
            return false;
        } else if (strcmp(argv[i], "--bind") == 0) {
            asked->bind = argv[++i];
        } else if (strcmp(argv[i], "--port") == 0 && number(argv[i + 1], 65535, &value)) {
            asked->port = (uint16_t)value;
            asked->has_port = true;
            i++;
        } else if (strcmp(argv[i], "--count") == 0 && number(argv[i + 1], 4294967295UL, &value)) {
            asked->count = value;
            i++;
        } else {
            return false;
        }
    }
    return asked->has_port;
}

static int listen_on(const struct asked *asked)
{
    struct sockaddr_in address = { .sin_family = AF_INET, .sin_port = htons(asked->port) };
    if (inet_pton(AF_INET, asked->bind, &address.sin_addr) != 1) {
        fprintf(stderr, "%s is no IPv4 address\n", asked->bind);
        return -1;
    }
    int receiver = socket(AF_INET, SOCK_DGRAM, 0);
    if (receiver < 0 || bind(receiver, (struct sockaddr *)&address, sizeof address) != 0) {
        perror("cannot listen");
        return -1;
    }
    socklen_t length = sizeof address;
    if (getsockname(receiver, (struct sockaddr *)&address, &length) == 0)
        fprintf(stderr, "listening on %s:%u\n", asked->bind, (unsigned)ntohs(address.sin_port));
    return receiver;
}

static const char *name(const char *const *names, size_t count, unsigned code)
{
    return code < count ? names[code] : "?";
}

static void print(const struct tumbled_telemetry *state)
{
    static const char *const origins[] = { "?", "live", "replay", "simulated" };
    static const char *const modes[] = { "no_target", "acquiring", "tracking", "predicted", "lost" };
    static const char *const validities[] = { "invalid", "degraded", "ok" };
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    double age_ms = (double)((int64_t)now.tv_sec * 1000000000 + now.tv_nsec - state->unix_ns) / 1e6;
    const double *p = state->position_m, *q = state->rotation_xyzw;
    printf("%lu %s %s %s position %+.4f %+.4f %+.4f rotation %+.5f %+.5f %+.5f %+.5f age %.1f ms\n",
           (unsigned long)state->sequence, name(origins, 4, state->origin), name(modes, 5, state->mode),
           name(validities, 3, state->validity), p[0], p[1], p[2], q[0], q[1], q[2], q[3], age_ms);
    fflush(stdout);
}

int main(int argc, char **argv)
{
    struct asked asked = { .bind = "127.0.0.1" };
    if (!parse(argc, argv, &asked))
        return usage();
    int receiver = listen_on(&asked);
    if (receiver < 0)
        return 1;

    unsigned char bytes[2048];
    unsigned char session[16] = { 0 };
    uint32_t next = 0;
    bool is_first = true;
    unsigned long good = 0;
    while (asked.count == 0 || good < asked.count) {
        ssize_t count = recv(receiver, bytes, sizeof bytes, 0);
        if (count < 0) {
            perror("cannot receive");
            return 1;
        }
        struct tumbled_telemetry state;
        const char *wrong = tumbled_telemetry_read(bytes, (size_t)count, &state);
        if (wrong != NULL) {
            fprintf(stderr, "dropped: %s\n", wrong);
            continue;
        }
        if (state.origin != TUMBLED_LIVE && !asked.allow_nonlive) {
            fprintf(stderr, "refused: the data are not live (--allow-nonlive takes them)\n");
            return 3;
        }
        if (is_first || memcmp(session, state.session, sizeof session) != 0) {
            memcpy(session, state.session, sizeof session);
            next = state.sequence;
            is_first = false;
        }
        /* The number wraps: a step of more than half of all numbers is one back. */
        uint32_t missing = state.sequence - next;
        if (missing >= UINT32_C(0x80000000)) {
            fprintf(stderr, "dropped: %lu comes late\n", (unsigned long)state.sequence);
            continue;
        }
        if (missing > 0)
            fprintf(stderr, "lost: %lu before %lu\n", (unsigned long)missing, (unsigned long)state.sequence);
        next = state.sequence + 1;
        good++;
        print(&state);
    }
    return 0;
}
